"""The window as a user would operate it: a separate process, real X events, pixels read from the screen."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gui.platform.x_window import XDisplay
from tests.support.waiting import wait_until


def _pixels(path: Path) -> np.ndarray:
    import cv2

    image = cv2.imread(str(path))
    assert image is not None
    return image[..., ::-1]


LIST = ("the list", lambda s: s["dialog"] == "commands" and s["typing"])


def test_a_stream_plays_seeks_turns_and_commands_are_found(
    open_window: Callable,
    display: str,
    stream_folder: Path,
    tmp_path: Path,
    artifacts: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    window = open_window(str(stream_folder), "--size", "1000x640", plays=True)
    first = window.wait_for("a picture, playing", lambda s: s["shown"] is not None and s["playing"])
    assert first["frames"] == 12
    monkeypatch.setenv("DISPLAY", display)
    server = XDisplay()
    assert server.least_sizes(window.process.pid) == [(816, 640)], "smaller, controls would be cut off"
    server.close()
    assert "walking stream" in first["title"]
    window.wait_for("playing on", lambda s: s["shown"] != first["shown"])

    # during playback all numbers are those of the picture
    def numbers() -> list[list[int]]:
        return [s["numbers"] for s in window.states() if s["playing"] and None not in s["numbers"]]

    wait_until("some draws", lambda: len({str(one) for one in numbers()}) > 3)
    drawn = numbers()
    assert all(len(set(one)) == 1 for one in drawn), drawn

    window.xdotool("mousemove", 1395, 895)  # where another test may have left the pointer
    window.key("space")
    window.wait_for("paused", lambda s: not s["playing"] and s["settled"])
    window.click("play")
    window.wait_for("playing again", lambda s: s["playing"])
    window.key("space")
    window.wait_for("paused again", lambda s: not s["playing"])
    window.key("Home")
    window.wait_for("the first frame", lambda s: s["frame"] == 0 and s["shown"] == 0)
    window.key("Right")
    window.wait_for("the second frame", lambda s: s["frame"] == 1 and s["shown"] == 1)
    window.click("forward")
    window.wait_for("the third frame", lambda s: s["frame"] == 2 and s["shown"] == 2)
    window.key("bracketright")
    window.wait_for("the next group", lambda s: s["frame"] == 8 and s["shown"] == 8)
    window.click("timeline", window.across_frame(5), 0.9)
    before = window.wait_for("frame 5 by a click", lambda s: s["frame"] == 5 and s["shown"] == 5)
    window.drag("timeline", (window.across_frame(1), 0.6), (window.across_frame(10), 0.6))
    window.wait_for("frame 10 by a drag", lambda s: s["frame"] == 10 and s["shown"] == 10)

    # the screen shows the colors of the body, and orbiting changes them
    shot = tmp_path / "before.png"
    seen = window.inside("viewport")
    wait_until("on the screen", lambda: _colored(_pixels(window.screenshot(shot))[seen]) > 5000)
    one = _pixels(shot)[seen]
    window.drag("viewport", (0.4, 0.5), (0.6, 0.4))
    turned = window.wait_for("another view", lambda s: s["orbit"] != before["orbit"] and s["settled"])
    assert turned["orbit"][0] != before["orbit"][0]
    wait_until("on the screen", lambda: np.abs(_pixels(window.screenshot(shot))[seen].astype(int) - one).mean() > 3.0)
    window.screenshot(artifacts / "window_playing.png")
    window.drag("viewport", (0.5, 0.5), (0.6, 0.5), button=3)
    window.wait_for("a moved target", lambda s: s["orbit"][3:] != turned["orbit"][3:])
    window.key("r")
    window.wait_for("the first view", lambda s: s["orbit"] == first["orbit"])

    # commands are found by typing, and run by Enter or a click
    window.chord("k")
    state = window.wait_for(*LIST)
    everything = state["lines"]
    assert len(everything) > 30
    window.enter_text("dialog line", "html rep")
    window.wait_for("what is found", lambda s: s["lines"] == ["Write HTML report"])
    window.key("Return")
    window.ticks(30)
    assert window.states()[-1]["dialog"] == "commands", "a stream has no report: the list stays and says so"
    window.key("Escape")
    window.wait_for("no dialog", lambda s: not s["dialog"])

    # by a click on the last row that is in view at first
    figures = window.states()[-1]["figures"]
    window.chord("k")
    window.wait_for(*LIST)
    window.enter_text("dialog line", "view")
    window.wait_for("what is typed", lambda s: s["texts"].get("dialog line") == "view")
    window.ticks(30)  # the list of an earlier letter may begin with the same row
    found = window.states()[-1]["lines"]
    assert found[0] == "Reset view"
    row = found.index("Inspector and log")
    assert 6 < row < 12, "below the middle of the list, which must not scroll under the pointer"
    window.click("dialog list", 0.5, (row + 0.5) / 12)
    window.wait_for("other figures", lambda s: not s["dialog"] and s["figures"] != figures)

    # keys that are typed at once are for the list, and none is a shortcut; Enter runs
    known = len(window.states())
    window.xdotool("key", "ctrl+k", "type", "--delay", 15, "full")
    window.wait_for("what is typed", lambda s: s["texts"].get("dialog line") == "full")
    assert not any(state["fullscreen"] for state in window.states()[known:])
    window.key("Return")
    window.wait_for("fullscreen", lambda s: not s["dialog"] and s["fullscreen"])

    # keys select: the last command is about the program
    window.chord("k")
    window.wait_for(*LIST)
    for _ in range(len(everything) // 12 + 1):
        window.key("Next")
    window.key("Return")
    window.wait_for("about", lambda s: s["dialog"] == "message")
    assert window.close() == 0, window.stderr.read_text()[-2000:]


def _colored(pixels: np.ndarray) -> int:
    """Number of pixels that are not gray."""
    return int(((pixels.max(-1).astype(int) - pixels.min(-1)) > 60).sum())
