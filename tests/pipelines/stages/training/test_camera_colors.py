from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.color_charts import matrices, view_of_chart
from tests.support.errors import refuses
from tests.support.events import warnings_in
from tests.support.tiny_capture import run_take, settings_in
from v3studio.pipelines.events import Event, Warned
from v3studio.pipelines.runs.runner import status
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training.camera_colors import ensure_camera_colors
from v3studio.pipelines.stages.training.plan import TrainPlan
from v3studio.pipelines.stages.training.views import ViewReader
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


@pytest.fixture
def charted(copied: Path) -> tuple[Path, np.ndarray]:
    """The tiny capture at ten times its size, used at its own, with a chart in frame 2, the last, and the cameras'
    matrices. cam3 does not see the chart."""
    truth = matrices(4)
    chosen = dict(zip(("cam0", "cam1", "cam2", "cam5"), truth, strict=True))
    for folder in sorted((copied / "capture" / "images").iterdir()):
        for path in (folder / "000.png", folder / "001.png"):
            image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            cv2.imwrite(str(path), cv2.resize(image, None, fx=10, fy=10, interpolation=cv2.INTER_NEAREST))
        height, width = image.shape[0] * 10, image.shape[1] * 10
        chart = np.full((height, width, 3), 140, np.uint8)
        if folder.name in chosen:
            chart = view_of_chart(chosen[folder.name], int(folder.name[3:]), size=(width, height))
        for number in (3, 4):
            (folder / f"{number:03d}.png").unlink()
        cv2.imwrite(str(folder / "002.png"), np.dstack([chart[..., ::-1], np.zeros((height, width), np.uint8)]))
    return copied, truth


CHART = ("capture.scale=0.1", "capture.frames=:2", "train.camera_colors=2")


def test_they_come_from_a_chart_outside_of_the_take(charted: tuple[Path, np.ndarray]) -> None:
    project, truth = charted
    run_take(project, *CHART[:2], stages=INITIALIZED)
    with refuses("color_chart.too_few", frame=0):
        train(project, *CHART[:2], "train.camera_colors=0")
    events = train(project, *CHART)
    take = Take.open(project / "take")
    stored = read_json(take.camera_colors)
    assert stored["frame"] == 2
    assert set(stored["cameras"]) == {"cam0", "cam1", "cam2", "cam5"}
    found = np.stack([stored["cameras"][name] for name in ("cam0", "cam1", "cam2", "cam5")])
    assert np.abs(found @ [0.3, 0.5, 0.7, 1] - truth @ [0.3, 0.5, 0.7, 1]).max() < 0.01
    (warning,) = warnings_in(events, "training.no_color_chart")
    assert "in frame 2, cam3: no ColorChecker" in warning.message

    views = {}
    for options in (CHART[:2], CHART):
        context = Inputs(take, settings_in(project, *options))
        seen = ViewReader.of(context).views(0, StageReporter("train", events.append))
        views[len(options)] = {view.camera.name: view.color for view in seen}
    assert all(color is None for color in views[len(CHART) - 1].values())
    assert [name for name, color in views[len(CHART)].items() if color is None] == ["cam3"]


def test_the_command_shows_what_is_found(charted: tuple[Path, np.ndarray], here: Callable) -> None:
    project, _ = charted
    done = here("colors", project / "ball.yaml", "--chart-frame", 2).ok()
    lines = done.stdout.splitlines()
    assert [line.split(":")[0] for line in lines[:5]] == ["cam0", "cam1", "cam2", "cam3", "cam5"], "no held-out camera"
    assert lines[3] == "cam3: no ColorChecker is seen; not corrected"
    before, after = (float(word) for word in lines[0].split() if word[0].isdigit() and "." in word)
    assert after < 1 < before
    assert lines[-1] == "train: {camera_colors: 2}"
    here("colors", project / "ball.yaml", "--chart-frame", 9).fails("frames 0 to 2")
