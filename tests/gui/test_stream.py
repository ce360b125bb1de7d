"""A stream in the window: played, turned, shared and served, with a command that fails on the way."""

import urllib.request
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch

from tests.gui.conftest import RunningWindow, body, write_stream
from tests.support.waiting import wait_until
from v3studio.studio.gaussians import Gaussians

FAILING = """
import sys
from v3studio.gui.models.playback.transport import Transport

def set_loop(self, on):
    raise RuntimeError("the loop is stuck")

Transport.set_loop = set_loop
from v3studio.gui.app import main
sys.exit(main())
"""

LIST = ("the list", lambda s: s["dialog"] == "commands" and s["typing"])


def test_a_stream_is_played_shared_and_served(open_window: Callable[..., RunningWindow], tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    write_stream(folder, two_bodies)
    window = open_window(str(folder), program=("-c", FAILING), plays=True)
    first = window.wait_for("a picture, playing", lambda s: s["shown"] is not None and s["playing"])
    assert first["frames"] == 12
    assert "walk" in first["title"]
    window.wait_for("playing on", lambda s: s["shown"] != first["shown"])

    # during playback all numbers are those of the picture
    def numbers() -> list[list[int]]:
        return [s["numbers"] for s in window.states() if s["playing"] and None not in s["numbers"]]

    wait_until("some draws", lambda: len({str(one) for one in numbers()}) > 3)
    drawn = numbers()
    assert all(len(set(one)) == 1 for one in drawn), drawn

    window.xdotool("mousemove", 1395, 895)  # where another test may have left the pointer
    window.key("space", until=("paused", lambda s: not s["playing"] and s["settled"]))
    window.click("play", until=("playing again", lambda s: s["playing"]))
    window.key("space", until=("paused again", lambda s: not s["playing"]))
    window.key("Home", until=("the first frame", lambda s: s["frame"] == 0 and s["shown"] == 0))
    window.key("Right", until=("the second frame", lambda s: s["frame"] == 1 and s["shown"] == 1))
    window.click("forward", until=("the third frame", lambda s: s["frame"] == 2 and s["shown"] == 2))
    window.key("bracketright", until=("the next group", lambda s: s["frame"] == 8 and s["shown"] == 8))
    window.click("timeline", window.across_frame(5), 0.9)
    before = window.wait_for("frame 5 by a click", lambda s: s["frame"] == 5 and s["shown"] == 5)
    window.drag("timeline", (window.across_frame(1), 0.6), (window.across_frame(10), 0.6))
    window.wait_for("frame 10 by a drag", lambda s: s["frame"] == 10 and s["shown"] == 10)

    # the screen shows both bodies, at eye level, and orbiting changes their colors
    wait_until("on the screen", lambda: colored(window.pixels("viewport")).sum() > 5000)
    one = window.pixels("viewport")
    high, wide = one.shape[:2]
    rows, columns = np.nonzero(colored(one))
    assert 0.02 * wide < columns.min() < 0.4 * wide
    assert 0.6 * wide < columns.max() < 0.98 * wide
    assert 0.02 * high < rows.min() < rows.max() < 0.98 * high
    assert abs(before["orbit"][1]) < 0.3, "radians"
    window.drag("viewport", (0.4, 0.5), (0.6, 0.4))
    turned = window.wait_for("another view", lambda s: s["orbit"] != before["orbit"] and s["settled"])
    assert turned["orbit"][0] != before["orbit"][0]
    wait_until("on the screen", lambda: np.abs(window.pixels("viewport").astype(int) - one).mean() > 3.0)
    window.drag("viewport", (0.5, 0.5), (0.6, 0.5), button=3)
    window.wait_for("a moved target", lambda s: s["orbit"][3:] != turned["orbit"][3:])
    window.key("r", until=("the first view", lambda s: s["orbit"] == first["orbit"]))

    # the wheel over an open list is for the list, also where the timeline is below it
    across, down = window.point("speed")
    window.press(across, down)
    wheel = ("mousemove", across, down - 60, "click", 4, "click", 4)
    window.send(*wheel)
    window.ticks(30)
    assert window.states()[-1]["zoom"] is None
    window.click("viewport")  # which closes the list
    window.send(*wheel)
    window.wait_for("a zoomed timeline", lambda s: s["zoom"])

    # commands are found by typing, and run by Enter or a click
    state = window.chord("k", until=LIST)
    everything = state["lines"]
    assert len(everything) > 30
    window.enter_text("dialog line", "html rep")
    window.wait_for("what is found", lambda s: s["lines"] == ["Write HTML report"])
    window.key("Return")
    window.ticks(30)
    assert window.states()[-1]["dialog"] == "commands", "a stream has no report: the list stays and says so"
    window.key("Escape", until=("no dialog", lambda s: not s["dialog"]))

    # by a click on the last row that is in view at first
    figures = window.states()[-1]["figures"]
    window.chord("k", until=LIST)
    window.enter_text("dialog line", "view")
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
    window.key("Return", until=("fullscreen", lambda s: not s["dialog"] and s["fullscreen"]))

    # keys select: the last command is about the program
    window.chord("k", until=LIST)
    window.send("key", *["Next"] * (len(everything) // 12 + 1), "Return")
    window.wait_for("about", lambda s: s["dialog"] == "message")
    window.key("Escape", until=("no dialog", lambda s: not s["dialog"]))
    window.key("Escape", until=("the panels", lambda s: not s["fullscreen"]))

    # a command that fails is reported, and the window stays
    window.key("l", until=("the message", lambda s: "the loop is stuck" in s["notice"]))
    window.click("notice dismiss", until=("no message", lambda s: s["notice"] == ""))
    assert "RuntimeError: the loop is stuck" in window.stderr.read_text()

    # an export that is refused keeps what was typed
    state = window.menu("Export", "export", until=("the options", lambda s: s["dialog"] == "export" and s["typing"]))
    assert state["texts"]["dialog line"].endswith(f"-ply-frame-{state['number']}.ply"), "the frame under review"
    window.retype("dialog line", str(folder))
    window.click("dialog save")
    window.wait_for("a refusal", lambda s: s["dialog"] == "export" and s["texts"]["dialog line"] == str(folder))
    window.click("dialog close", until=("no dialog", lambda s: not s["dialog"]))

    # a share, with what was chosen last, and over an earlier one
    window.menu("Share", "share folder", until=("dialog", lambda s: s["dialog"] == "share"))
    assert window.states()[-1]["texts"]["dialog line"] == str(tmp_path / "walk-share")
    window.enter_text("dialog title", "A walk")  # the first field has the focus
    places = window.states()[-1]["widgets"]
    assert places["dialog line"][0] == places["dialog title"][0], "the output is below the other fields"
    window.click("dialog save")
    state = window.wait_for(
        "what was written", lambda s: s["notice"].startswith("Shared: ") and "notice open_folder" in s["widgets"], 180
    )
    shared, manifest = tmp_path / "walk-share", (folder / "manifest.json").read_bytes()
    assert (shared / "stream" / "manifest.json").read_bytes() == manifest
    assert state["dialog"] == "", "nothing stops the work"
    assert "<title>A walk</title>" in (shared / "index.html").read_text()

    state = window.menu("Share", "share folder", until=("dialog again", lambda s: s["dialog"] == "share"))
    assert state["texts"]["dialog title"] == "A walk", "it begins with what was chosen last"
    window.click("dialog line")
    window.key("End")
    window.enter_text("dialog line", "name" * 65)  # longer than file systems allow
    window.click("dialog save")
    window.xdotool("type", "z")
    window.wait_for("the first field focused", lambda s: s["texts"].get("dialog title", "")[-1:] == "z")
    assert "bug" not in window.states()[-1]["notice"]
    window.click("dialog close", until=("no dialog", lambda s: not s["dialog"]))
    window.menu("Share", "share folder", until=("dialog again", lambda s: s["dialog"] == "share"))
    window.click("dialog save", until=("a question", lambda s: s["dialog"] == "ask"))
    (shared / "index.html").write_text("the earlier page")
    window.click("dialog replace", until=("the new page", lambda s: s["exporting"] == "" and not s["dialog"]))
    wait_until("replaced", lambda: "A walk" in (shared / "index.html").read_text(), 180)

    window.menu("Share", "serve", until=("dialog", lambda s: s["dialog"] == "serve"))
    window.click("dialog https", 0.1)
    window.click("dialog save")
    state = window.wait_for("the code", lambda s: s["dialog"] == "serving" and s["widgets"].get("dialog qr"), 180)
    assert state["serving"].startswith("http://")
    wait_until("the code on the screen", lambda: read_code(window) == state["serving"])
    port = state["serving"].rstrip("/").rpartition(":")[2]
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/manifest.json") as answer:
        assert answer.read() == manifest
    window.click("dialog stop", until=("the end", lambda s: s["serving"] == "" and s["dialog"] == ""))
    assert window.close() == 0


def two_bodies(frame: int) -> Gaussians:
    """Two performers, far apart."""
    one = body(frame)
    return Gaussians.cat(*(replace(one, means=one.means + torch.tensor([0.0, y, 0.0])) for y in (-1.2, 1.2)))


def colored(pixels: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels that are not gray."""
    found: np.ndarray = (pixels.max(-1).astype(int) - pixels.min(-1)) > 60
    return found


def read_code(window: RunningWindow) -> str:
    """What the QR code says."""
    return cv2.QRCodeDetectorAruco().detectAndDecode(np.ascontiguousarray(window.pixels("dialog qr")))[0]
