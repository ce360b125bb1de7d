from itertools import pairwise
from pathlib import Path

import pytest

from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.capture import camera_color_pairs
from v3studio.gui.pages.capture.camera_color_pairs import CameraColorsView
from v3studio.pipelines.takes.files.json_files import write_model
from v3studio.pipelines.takes.results.stage_files import CameraColors
from v3studio.pipelines.takes.take import Take

MATRIX = ((0.8, 0.05, 0.0, 0.02), (0.0, 1.1, 0.0, -0.01), (0.1, 0.0, 0.9, 0.0))
SIZE = (900, 600)


def test_they_appear_as_they_are_read(workspace: Workspace, take_copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace.open(Take.open(take_copy))
    monkeypatch.setattr(camera_color_pairs, "SECONDS", -1.0)  # one camera per draw
    workspace.change_settings({"train.camera_colors": "splats"})
    names = (*workspace.context.calibrated_footage.train_cameras[:2], "gone")
    colors = CameraColors(key="k", frame=0, cameras=dict.fromkeys(names, MATRIX))
    write_model(workspace.context.take.camera_colors, colors)
    pairs = CameraColorsView(workspace)
    pictures = []
    for _ in names:
        stamp = pairs.state()
        pictures.append(pairs.draw(SIZE, ()))
        assert pairs.state() != stamp, "drawn again"
    assert [name for name, _ in pairs.places] == list(names)
    assert all((before != after).any() for before, after in pairwise(pictures))
    stamp = pairs.state()
    assert (pairs.draw(SIZE, ()) == pictures[-1]).all()
    assert pairs.state() == stamp, "at rest"
