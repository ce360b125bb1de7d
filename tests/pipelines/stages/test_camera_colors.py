"""The colors of cameras in a take: fitted once, the same from any worker."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.config import load_config, parse_override
from pipelines.events import Warned
from pipelines.events.cancellation import Cancellation
from pipelines.runs.runner import run, status
from pipelines.stages.base import Context, StageReporter
from pipelines.stages.camera_colors import ensure_camera_colors
from pipelines.takes.atomic_files import read_json
from pipelines.takes.take import Take
from tests.support.errors import refuses

OPTIONS = ("train.camera_colors=true", "train.camera_color_iterations=20", "train.camera_color_every=10")


@pytest.fixture
def uneven(finished: Path, tmp_path: Path) -> Path:
    """The tiny capture with one camera that is much darker than the others, and its take up to the initial points."""
    shutil.copytree(finished, tmp_path / "project")
    for path in (tmp_path / "project" / "capture" / "images" / "cam1").iterdir():
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        image[..., :3] = (image[..., :3] * 0.6).astype(np.uint8)
        cv2.imwrite(str(path), image)
    train(tmp_path / "project", until="initialize")
    return tmp_path / "project"


def train(project: Path, *overrides: str, until: str = "train") -> list:
    events: list = []
    config = load_config(project / "ball.yaml", [parse_override(text) for text in overrides])
    stages = ("calibrate", "initialize", "train")
    run(Take.open(project / "take"), config, events.append, stages=stages[: stages.index(until) + 1])
    return events


def frames_of(take: Take) -> dict[str, bytes]:
    files = [*(take.root / "train").rglob("*.safetensors"), take.camera_colors]
    return {path.name: path.read_bytes() for path in files}


def test_they_are_kept_in_the_take_and_come_back_bit_for_bit(uneven: Path) -> None:
    take = Take.open(uneven / "take")
    events = train(uneven, *OPTIONS)
    assert not [event for event in events if isinstance(event, Warned)]
    matrices = {name: np.array(one) for name, one in read_json(take.camera_colors)["cameras"].items()}
    assert set(matrices) == {"cam0", "cam1", "cam2", "cam3", "cam5"}, "no held-out camera"
    assert np.allclose(np.mean(list(matrices.values()), 0), np.eye(3, 4), atol=1e-9)
    gray = {name: float((one @ [0.5, 0.5, 0.5, 1]).mean()) for name, one in matrices.items()}
    assert min(gray, key=lambda name: gray[name]) == "cam1"
    assert gray["cam1"] < 0.9 * np.mean(list(gray.values()))

    first = frames_of(take)
    # as after a kill: the matrices and the frames of the second group are gone
    take.camera_colors.unlink()
    for path in take.train_group(1).glob("*.safetensors"):
        path.unlink()
    train(uneven, *OPTIONS)
    assert frames_of(take) == first

    # without them, other frames, and nothing of them is left
    train(uneven)
    assert not take.camera_colors.exists()
    assert (take.trained_frame(0, 0)).read_bytes() != first["frame_000000.safetensors"]
    config = load_config(uneven / "ball.yaml", [parse_override(text) for text in OPTIONS])
    assert status(take, config)["train"].state == "stale"


def test_without_the_first_groups_points_it_says_so(uneven: Path) -> None:
    from pipelines.runs.work import work

    take = Take.open(uneven / "take")
    config = load_config(uneven / "ball.yaml", [parse_override(text) for text in OPTIONS])
    (take.initialize_group(0) / "points.ply").unlink()
    with refuses("training.no_first_points"):
        work(take, config, ("train",), 1, lambda event: None)


def test_a_camera_that_is_not_corrected_is_named(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished, tmp_path / "project")
    path = tmp_path / "project" / "capture" / "images" / "cam1" / "000.png"
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    image[..., 3] = 0
    cv2.imwrite(str(path), image)
    train(tmp_path / "project", until="initialize")
    config = load_config(tmp_path / "project" / "ball.yaml", [parse_override(text) for text in OPTIONS])
    events: list = []
    context = Context(Take.open(tmp_path / "project" / "take"), config, events.append)
    ensure_camera_colors(context, StageReporter("train", context), "key", Cancellation())
    (warning,) = [one for one in events if isinstance(one, Warned) and one.code == "training.no_camera_color"]
    assert "the colors of cam1 are not corrected" in warning.message
