"""Train, camera colors: images as filmed and corrected."""

import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from gui.models.take.workspace import Workspace
from gui.pages.capture import camera_color_pairs
from gui.pages.capture.camera_color_pairs import CameraColorPairs, pair
from pipelines.takes.atomic_files import write_model
from pipelines.takes.stage_files import CameraColors
from pipelines.takes.take import Take
from studio.cameras import Camera
from studio.capture import FootageView
from studio.color_fit import correct_color

MATRIX = ((0.8, 0.05, 0.0, 0.02), (0.0, 1.1, 0.0, -0.01), (0.1, 0.0, 0.9, 0.0))
SIZE = (900, 600)


def colors_of(**cameras: tuple[tuple[float, float, float, float], ...]) -> CameraColors:
    return CameraColors(key="k", frame=0, cameras=cameras)


def test_the_correction_is_the_inverse_of_what_the_camera_did() -> None:
    truth = np.random.default_rng(1).uniform(0.2, 0.7, (60, 80, 3)).astype(np.float32)
    camera = Camera("cam0", 80, 60, np.array([[70.0, 0, 40], [0, 70.0, 30], [0, 0, 1]]), np.eye(4))
    filmed = correct_color(torch.from_numpy(truth), torch.ones(60, 80), torch.tensor(MATRIX))
    mask = np.zeros((60, 80), np.uint8)
    mask[22:40, 30:52] = 255
    view = FootageView(camera, (255 * filmed).round().byte().numpy(), mask, 0, None)
    left, right = pair(view, colors_of(cam0=MATRIX))
    rows, columns = slice(22 - 17, 40 + 17), slice(30 - 17, 52 + 17)  # 16 pixels, and 8% of 18 and 22
    assert (left == view.image[rows, columns]).all()
    assert np.abs(right / 255 - truth[rows, columns]).max() < 2 / 255
    assert np.abs(left / 255 - truth[rows, columns]).max() > 0.1


@pytest.fixture(autouse=True)
def _opened(workspace: Workspace, finished_project: Path, tmp_path: Path) -> None:
    shutil.copytree(finished_project, tmp_path / "project")
    workspace.open(Take.open(tmp_path / "project" / "take"))


def test_cameras_appear_as_they_are_read(workspace: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_color_pairs, "SECONDS", -1.0)  # one camera per draw
    workspace.change_setting("train.camera_colors", "splats")
    names = (*workspace.context.footage.calibrated.train_cameras[:2], "gone")
    colors = colors_of(**dict.fromkeys(names, MATRIX))
    write_model(workspace.context.take.camera_colors, colors)
    pairs = CameraColorPairs(workspace)
    pictures = []
    for _ in names:
        stamp = pairs.stamp
        pictures.append(pairs.draw(SIZE, 16.0))
        assert pairs.stamp != stamp, "drawn again"
    assert [name for name, _ in pairs.places] == list(names)
    assert all((one != other).any() for one, other in pairwise(pictures))
    stamp = pairs.stamp
    assert (pairs.draw(SIZE, 16.0) == pictures[-1]).all()
    assert pairs.stamp == stamp, "at rest"
