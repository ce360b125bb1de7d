"""The scene and the cameras in the real window: turned, played, clicked, chosen in menus and in the list."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from gui.drawing.palette import FAIR
from gui.models.take.cameras import CameraUses
from pipelines.config import Config, load_config
from studio.capture import CaptureSettings
from tests.gui.conftest import RunningWindow
from tests.support.errors import refuses
from tests.support.waiting import wait_until


def press(window: RunningWindow, camera: str, button: int) -> None:
    """Click what shows a camera."""
    state = window.wait_for(f"a place of {camera}", lambda s: s["settled"] and camera in s["places"])
    window.send("mousemove", *window.point("viewport", *state["places"][camera]))
    window.send("mousedown", button)
    window.send("mouseup", button)


def box_pixels(window: object, path: Path) -> int:
    """Pixels of the viewport in the color of the box around the visual hull."""
    pixels = cv2.imread(str(window.screenshot(path)))[window.inside("viewport")]  # type: ignore[attr-defined]
    return int((np.abs(pixels[..., ::-1].astype(int) - FAIR) < 30).all(axis=2).sum())


def test_the_scene_and_cameras_that_are_clicked_held_out_and_excluded(
    open_window: Callable, take_copy: Path, artifacts: Path
) -> None:
    def capture() -> CaptureSettings:
        return load_config(take_copy / "config.yaml").capture

    before = capture()
    window = open_window(str(take_copy))
    window.wait_for("a take", lambda s: s["stages"]["review"][0] == "done" and s["shown"] is not None)
    window.key("Home")
    window.key("o")
    state = window.wait_for("the scene", lambda s: s["compare"] == "scene" and s["settled"] and "+x" in s["places"])
    assert "volume" in state["mode"]
    window.drawn()
    wait_until("the box", lambda: box_pixels(window, artifacts / "scene.png") > 200)
    orbit = state["orbit"]
    window.drag("viewport", (0.5, 0.8), (0.65, 0.7))
    window.wait_for("turned", lambda s: s["orbit"] != orbit and s["settled"])
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

    # cameras: menus, uses, the list
    window.stage("capture")
    press(window, "cam0", 3)
    window.wait_for("its menu", lambda s: s["menu_camera"] == "cam0" and "camera list" in s["widgets"])
    window.click("camera list")
    window.wait_for("the list", lambda s: s["dialog"] == "cameras")
    window.screenshot(artifacts / "cameras_list.png")
    window.click("dialog hold out cam1", 0.2)
    window.click("dialog use cam0")
    window.click("dialog save")
    window.wait_for("stale results", lambda s: s["dialog"] == "" and s["stages"]["train"][0] != "done")
    assert capture().cameras == ("cam1", "cam2", "cam3", "cam4", "cam5")
    assert capture().held_out == ("cam1", "cam4")
    window.chord("z")
    window.wait_for("the results", lambda s: s["stages"]["train"][0] == "done")
    window.saw("a notice", lambda s: "Undone" in s["notice"])
    assert capture() == before
    press(window, "cam2", 1)
    window.wait_for("one camera", lambda s: s["alone"] == "cam2" and s["settled"] and list(s["places"]) == ["cam2"])
    window.key("Escape")
    window.wait_for("all cameras", lambda s: s["alone"] == "" and len(s["places"]) == 6)
    press(window, "cam2", 3)
    state = window.wait_for("its menu", lambda s: s["menu_camera"] == "cam2" and "camera held out" in s["widgets"])
    assert "camera training" not in state["widgets"]
    window.screenshot(artifacts / "cameras_menu.png")
    window.click("camera held out")
    window.wait_for("stale results", lambda s: s["menu_camera"] == "" and s["stages"]["train"][0] != "done")
    assert capture().held_out == ("cam2", "cam4")
    window.stage("calibrate")
    front = window.wait_for("frustums", lambda s: s["settled"] and len(s["places"]) > 2)["places"]
    nearest = list(front)[-1]
    press(window, nearest, 3)
    window.wait_for("its menu", lambda s: s["menu_camera"] == nearest and "camera errors" in s["widgets"])
    window.click("camera errors")
    window.wait_for("the report", lambda s: "report" in s["mode"] and s["settled"])
    window.chord("c")
    window.saw("the table on the clipboard", lambda s: "Copied the table" in s["notice"])
    window.screenshot(artifacts / "cameras_report.png")
    window.click("cameras")
    window.wait_for("the cameras", lambda s: "cameras" in s["mode"] and s["settled"])
    press(window, nearest, 1)
    window.wait_for("its view", lambda s: s["stage"] == "review" and s["camera"] == nearest and s["settled"])
    assert window.close() == 0, window.stderr.read_text()[-2000:]
    assert "top-level" not in window.stderr.read_text(), "Open3D draws more than 20 widgets of a window wrongly"


def test_uses_of_cameras_become_settings(footage_project: Path) -> None:
    root = footage_project / "capture"
    spec = CaptureSettings(root=root, held_out=("every 3",), offsets={"cam1": 2, "cam2": 0})
    uses = CameraUses.of(spec)
    assert uses.uses == {
        "cam0": "training", "cam1": "training", "cam2": "held out",
        "cam3": "training", "cam4": "training", "cam5": "held out",
    }  # fmt: skip
    changed = uses.with_use("cam1", "not used").settings(spec)
    assert changed == {
        "capture.cameras": ["cam0", "cam2", "cam3", "cam4", "cam5"],
        "capture.held_out": ["cam2", "cam5"],
        "capture.offsets": {"cam2": 0},
    }
    config = load_config(None, [("capture.root", str(root)), *changed.items()])
    assert CameraUses.of(config.capture) == uses.with_use("cam1", "not used")
    assert uses.settings(spec)["capture.cameras"] == [], "all of them"
    with refuses("gui.no_training_camera"):
        CameraUses(dict.fromkeys(uses.uses, "held out")).settings(spec)
    with pytest.raises(ValueError, match="one of training"):
        uses.with_use("cam1", "spare")
    assert Config().capture.cameras == ()
