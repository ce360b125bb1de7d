"""The scene drawn by Open3D in the real window: it resembles the composed one, plays, and its cameras are clicked."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from tests.gui.conftest import RunningWindow
from tests.support.waiting import wait_until


def seen(window: RunningWindow, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The viewport on the screen as RGB, and which of its pixels are drawn: on processors, Open3D sometimes leaves out
    tiles and bands, which stay black. The pointer is away from what shows a hint over it."""
    window.send("mousemove", *window.point("viewport", 0.5, 0.9))
    window.wait_for("no hint", lambda s: s["hint"] == "")
    window.drawn()
    pixels = cv2.imread(str(window.screenshot(path)))[window.inside("viewport")][..., ::-1]
    return pixels.astype(np.float32), pixels.any(axis=-1).astype(np.float32)


def apart(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> float:
    """Mean difference in levels where both are drawn, blurred: single lines do not count."""
    mask = one[1] * other[1]
    difference = np.abs(cv2.blur((one[0] - other[0]) * mask[..., None], (40, 40))).mean(axis=-1)
    return float((difference * mask).sum() / mask.sum())


def test_open3d_draws_what_is_composed_and_its_cameras_can_be_clicked(
    open_window: Callable, take_copy: Path, tmp_path: Path, artifacts: Path
) -> None:
    settings = tmp_path / "config" / "v3studio" / "window.json"
    window = open_window(str(take_copy))
    window.wait_for("a take", lambda s: s["stages"]["review"][0] == "done" and s["shown"] is not None)
    window.key("o")
    window.wait_for("the scene", lambda s: s["compare"] == "scene" and s["settled"] and "+x" in s["places"])
    for part in ("cameras", "grid", "axes", "volume"):
        window.click(part)
    window.wait_for("splats only", lambda s: s["mode"] == ["decoded", "splats"] and s["settled"])
    composed = seen(window, artifacts / "scene_composed.png")
    assert composed[0].std() > 5

    window.menu("View", "open3d")
    window.wait_for("Open3D's", lambda s: s["open3d"] is not None and s["settled"])
    window.saw("a warning", lambda s: "slow" in s["notice"])

    def alike() -> bool:
        native = seen(window, artifacts / "scene_open3d.png")
        return native[1].mean() > 0.5 and apart(native, composed) < 4

    wait_until("a picture as composed", alike)
    assert json.loads(settings.read_text())["scene_drawn_by"] == "Open3D"

    for frame in (1, 2):
        window.key("Right")
        window.wait_for("the next frame", lambda s, frame=frame: s["open3d"] == s["shown"] == frame)
    window.click("cameras")
    state = window.wait_for("cameras", lambda s: s["places"] and s["settled"])
    inside = {name: at for name, at in state["places"].items() if 0.1 < at[0] < 0.9 and 0.1 < at[1] < 0.9}
    across, down = list(inside.values())[-1]
    window.click("viewport", across, down)
    window.wait_for("through a camera", lambda s: s["camera"] != "" and s["open3d"] is not None)

    window.menu("View", "open3d")
    window.wait_for("the composed scene again", lambda s: s["open3d"] is None and s["settled"] and "+x" in s["places"])
    assert window.close() == 0
