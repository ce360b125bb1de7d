from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.events import warnings_in
from tests.support.tiny_capture import run_take, settings_in
from v3studio.pipelines.events import Event, Warned
from v3studio.pipelines.runs.runner import status
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training.camera_colors import ensure_camera_colors
from v3studio.pipelines.stages.training.plan import TrainPlan
from v3studio.pipelines.takes.files.json_files import read_json
from v3studio.pipelines.takes.take import Take

pytestmark = pytest.mark.long

FEW = ("train.keyframe_iterations=15", "train.motion_iterations=2", "train.finetune_iterations=3")
COLORS = "train.camera_colors=splats"
INITIALIZED = ("calibrate", "initialize")


@pytest.fixture(autouse=True)
def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("v3studio.studio.training.camera_colors.STEPS", 20)
    monkeypatch.setattr("v3studio.studio.training.camera_colors.EVERY", 10)


def train(project: Path, *overrides: str) -> list[Event]:
    return run_take(project, *FEW, *overrides, stages=(*INITIALIZED, "train"))


def frames_of(take: Take) -> dict[str, bytes]:
    files = [*(take.root / "train").rglob("*.safetensors"), take.camera_colors]
    return {path.name: path.read_bytes() for path in files}


def test_they_are_kept_in_the_take_and_come_back_bit_for_bit(copied: Path, take: Take) -> None:
    """One camera is much darker than the others."""
    for path in (copied / "capture" / "images" / "cam1").iterdir():
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        image[..., :3] = (image[..., :3] * 0.6).astype(np.uint8)
        cv2.imwrite(str(path), image)
    events = train(copied, COLORS)
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
    train(copied, COLORS)
    assert frames_of(take) == first

    # without them, other frames, and nothing of them is left
    train(copied)
    assert not take.camera_colors.exists()
    assert (take.trained_frame(0, 0)).read_bytes() != first["frame_000000.safetensors"]
    assert status(take, settings_in(copied, *FEW, COLORS))["train"].state == "stale"


def test_a_camera_that_is_not_corrected_is_named(copied: Path) -> None:
    path = copied / "capture" / "images" / "cam1" / "001.png"  # of the keyframe, the middle of its group
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    image[..., 3] = 0
    cv2.imwrite(str(path), image)
    run_take(copied, stages=INITIALIZED)
    events: list[Event] = []
    context = Inputs(Take.open(copied / "take"), settings_in(copied, COLORS))
    ensure_camera_colors(TrainPlan(context), StageReporter("train", events.append), "key")
    (warning,) = warnings_in(events, "training.no_camera_color")
    assert "the colors of cam1 are not corrected" in warning.message
