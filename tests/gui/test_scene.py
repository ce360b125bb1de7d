"""The scene in the real window: turn, change the stage, come back, seek, play, look through a camera."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from gui.drawing.palette import FAIR
from tests.support.waiting import wait_until


def box_pixels(window: object, path: Path) -> int:
    """Pixels of the viewport in the color of the box around the visual hull."""
    pixels = cv2.imread(str(window.screenshot(path)))[window.inside("viewport")]  # type: ignore[attr-defined]
    return int((np.abs(pixels[..., ::-1].astype(int) - FAIR) < 30).all(axis=2).sum())


def test_the_scene_survives_drags_stages_and_playback(open_window: Callable, take_copy: Path, artifacts: Path) -> None:
    window = open_window(str(take_copy))
    window.wait_for("a take", lambda s: s["stages"]["review"][0] == "done" and s["shown"] is not None)
    window.key("Home")
    window.key("o")
    state = window.wait_for("the scene", lambda s: s["compare"] == "scene" and s["settled"] and "+x" in s["places"])
    assert "volume" in state["mode"]
    window.drawn()
    wait_until("the box", lambda: box_pixels(window, artifacts / "scene.png") > 200)
    before = state["orbit"]
    window.drag("viewport", (0.5, 0.8), (0.65, 0.7))
    window.wait_for("turned", lambda s: s["orbit"] != before and s["settled"])
    window.stage("calibrate")
    window.wait_for("the scene is left", lambda s: s["compare"] == "single")
    window.stage("review")
    window.wait_for("the scene again", lambda s: s["compare"] == "scene" and s["settled"] and s["places"])
    window.stage("calibrate")
    window.key("o")
    state = window.wait_for("the scene again", lambda s: s["compare"] == "scene" and s["settled"] and s["places"])
    window.drawn()
    wait_until("the box", lambda: box_pixels(window, artifacts / "scene_after_stage.png") > 200)
    window.key("End")
    window.wait_for("the last frame", lambda s: s["shown"] == s["frames"] - 1 and s["settled"])
    window.key("space")
    at = window.wait_for("playing", lambda s: s["playing"])["pictures"]
    window.wait_for("more pictures", lambda s: s["pictures"] > at + 5)
    window.key("space")
    window.wait_for("paused", lambda s: not s["playing"] and s["settled"])
    window.drawn()
    with_box = box_pixels(window, artifacts / "scene_with_box.png")
    window.click("volume")
    window.wait_for("no box", lambda s: "volume" not in s["mode"] and s["settled"])
    # what is on the screen follows what is known
    wait_until("no box on it", lambda: box_pixels(window, artifacts / "scene_without_box.png") < 0.5 * with_box)
    across, down = window.states()[-1]["places"]["+z"]
    window.click("viewport", across, down)
    window.wait_for("from above", lambda s: abs(s["orbit"][1]) > 1.5 and s["settled"])
    window.key("Escape")
    window.wait_for("the take", lambda s: s["compare"] == "single")
