"""Cameras, meshes and points as geometry: what boards give, and Open3D's scene in the real window."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from gui.presenters.calibrate_board import CalibrateBoard
from gui.presenters.initialise_board import InitialiseBoard
from gui.presenters.scene_parts import wants_scene
from gui.presenters.workspace import Workspace
from pipelines.take import Take
from studio.camera_files import read_rig


@pytest.fixture
def workspace(finished_project: Path) -> Iterator[Workspace]:
    workspace = Workspace()
    workspace.open(Take.open(finished_project / "take"))
    end = time.monotonic() + 30
    while not workspace.assessed and time.monotonic() < end:
        workspace.poll()
        time.sleep(0.02)
    yield workspace
    workspace.close()


def test_who_draws() -> None:
    assert wants_scene("automatic", software=False)
    assert not wants_scene("automatic", software=True)
    assert wants_scene("Open3D", software=True)
    assert not wants_scene("our own", software=False)


def test_cameras_as_lines(workspace: Workspace) -> None:
    board = CalibrateBoard(workspace)
    parts = board.scene()
    assert workspace.take is not None
    assert parts is not None
    rig = read_rig(workspace.take.rig)
    assert parts.lines.shape == (8 * len(rig), 2, 3)
    for number, camera in enumerate(rig):
        edges = parts.lines[8 * number : 8 * number + 8]
        assert np.allclose(edges[:4, 0], camera.center), "four edges begin at the optical centre"
        x, y, z = camera.rotation @ edges[:4, 1].T + camera.translation[:, None]
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        assert np.allclose([u, v], [[0, camera.width, camera.width, 0], [0, 0, camera.height, camera.height]])
    assert board.scene() is parts, "read once"
    board.mode = "report"
    assert board.scene() is None, "a table is a picture"
    board.close()


def test_a_mesh_and_its_points(workspace: Workspace) -> None:
    board = InitialiseBoard(workspace, lambda path: None)  # type: ignore[arg-type, return-value]
    mesh = board.scene()
    assert mesh is not None
    assert mesh.mesh is not None
    assert mesh.mesh.is_file()
    board.mode = "points"
    points = board.scene()
    assert points is not None
    assert points.points.shape == points.colors.shape
    assert points.mesh is None
    assert points.stamp != mesh.stamp
    board.frame = 4
    later = board.scene()
    assert later is not None
    assert later.stamp != points.stamp, "the next group's"
    board.close()


def test_the_scene_in_the_window(
    open_window: Callable, finished_project: Path, tmp_path: Path, artefacts: Path
) -> None:
    settings = tmp_path / "config" / "v3studio"
    settings.mkdir(parents=True)
    (settings / "window.json").write_text(json.dumps({"scene": "Open3D", "play_on_opening": False}))
    window = open_window(str(finished_project / "take"))
    window.wait_for("the decoded stream", lambda s: s["shown"] is not None and s["settled"] and not s["scene"])
    for stage in ("calibrate", "initialise"):
        window.stage(stage)
        state = window.wait_for(f"the scene of {stage}", lambda s: s["scene"])
        deadline = time.monotonic() + 30
        while time.monotonic() < deadline:
            window.screenshot(artefacts / f"scene_{stage}.png")
            x, y = window.point("stages", 0.0, 0.0)
            left, top, width, height = state["widgets"]["viewport"]
            stages = state["widgets"]["stages"]
            origin = (x - stages[0] + left, y - stages[1] + top)
            pixels = cv2.imread(str(artefacts / f"scene_{stage}.png"))
            assert pixels is not None
            view = pixels[origin[1] + 20 : origin[1] + height - 20, origin[0] + 20 : origin[0] + width - 20]
            if (np.abs(view.astype(int) - view[0, 0].astype(int)).max(axis=2) > 25).mean() > 0.002:
                break
            time.sleep(1.0)
        else:
            pytest.fail(f"nothing is drawn in the scene of {stage}")
        before = view.copy()
        window.drag("viewport", (0.5, 0.5), (0.65, 0.55))
    assert before is not None
    window.stage("review")
    window.wait_for("the stream again", lambda s: not s["scene"] and s["settled"])
    assert window.close() == 0, window.stderr.read_text()[-2000:]
