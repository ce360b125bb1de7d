"""What the window shows is what it says, and nothing typed is lost; with real mouse and keyboard events."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.support.waiting import wait_until


def _pixels(path: Path) -> np.ndarray:
    import cv2

    image = cv2.imread(str(path))
    assert image is not None
    return image.astype(int)


def test_pictures_numbers_and_typed_text(
    open_window: Callable, take_copy: Path, tmp_path: Path, artifacts: Path
) -> None:
    settings = tmp_path / "config" / "v3studio"
    settings.mkdir(parents=True)
    # smaller than the viewport: pictures of splats and those of stages then differ in size
    (settings / "window.json").write_text(json.dumps({"picture_size": "640 x 360"}))
    window = open_window(str(take_copy), plays=True)
    window.wait_for("a picture", lambda s: s["shown"] is not None and s["playing"])

    # during playback all numbers are those of the picture
    def numbers() -> list[list[int]]:
        return [s["numbers"] for s in window.states() if s["playing"] and None not in s["numbers"]]

    wait_until("some draws", lambda: len({str(one) for one in numbers()}) > 3)
    drawn = numbers()
    assert all(len(set(one)) == 1 for one in drawn), drawn

    window.key("space")
    window.wait_for("paused", lambda s: not s["playing"] and s["settled"])
    window.key("Home")
    window.click("trained")
    window.wait_for("trained", lambda s: s["what"] == "trained" and s["shown"] == 0 and s["settled"])
    shot = tmp_path / "shot.png"

    def seen() -> np.ndarray:
        """The viewport, with the pointer away from what shows a hint over it."""
        window.send("mousemove", *window.point("viewport", 0.5, 0.9))
        window.wait_for("no hint", lambda s: s["hint"] == "")
        window.drawn()
        return _pixels(window.screenshot(shot))[window.inside("viewport")][40:]

    window.drawn()
    trained = seen()
    # a picture that begins as an earlier one did must not show what that one showed last
    window.stage("bake")
    window.stage("review")
    window.stage("initialize")
    window.click("points")
    window.wait_for("points", lambda s: s["mode"] == ["points"] and s["settled"])
    window.drawn()
    window.stage("bake")
    window.stage("review")
    window.wait_for("the review", lambda s: s["stage"] == "review" and s["settled"])
    wait_until("the trained splats again", lambda: np.abs(seen() - trained).mean() < 0.5)

    # text typed at once after the key, before the field has the focus
    window.xdotool("key", "m", "type", "--delay", 1, "at Once")
    window.wait_for("the text", lambda s: s["typing"] and s["texts"].get("dialog line") == "at Once")
    window.key("Return")
    window.wait_for("the mark", lambda s: s["marks"] == {"0": "at Once"} and s["dialog"] == "")

    # an export that is refused keeps everything typed
    window.menu("Export", "export turntable")
    window.wait_for("the options", lambda s: s["dialog"] == "export")
    window.retype("dialog seconds", "long")
    window.click("dialog save")
    window.wait_for("a refusal", lambda s: s["dialog"] == "export" and s["texts"]["dialog seconds"] == "long")
    window.screenshot(artifacts / "one_state_refused_export.png")
    window.click("dialog close")

    # what cannot be opened is told for a while, not over the picture
    window.menu("File", "address")
    window.wait_for("the question", lambda s: s["dialog"] == "address" and s["typing"])
    window.enter_text("dialog line", str(tmp_path / "nothing"))
    window.key("Return")
    state = window.wait_for("a notice", lambda s: "no such folder" in s["notice"])
    assert state["message"] == ""
    assert state["dialog"] == ""
    assert window.close() == 0, window.stderr.read_text()[-2000:]
