import json
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.support.tiny_capture import run_take, settings_in
from v3studio.pipelines.events import Event, Log
from v3studio.pipelines.runs.runner import run, status
from v3studio.pipelines.stages import stage_named
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.results.stage_files import CameraRefinement
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig
from v3studio.studio.errors import Cancelled

pytestmark = pytest.mark.long

SCHEDULE = ("train.keyframe_iterations=50", "train.motion_iterations=2", "train.finetune_iterations=3")
ALWAYS = ("train.refine_cameras=always", *SCHEDULE)


@pytest.fixture(autouse=True)
def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("v3studio.studio.training.camera_refinement.ALIGN_STEPS", 5)


@pytest.fixture
def turned(copied: Path) -> Path:
    """The tiny capture, where the file says that cam1 looks 5 pixels to the side."""
    path = copied / "capture" / "cameras.json"
    rig = json.loads(path.read_text())
    for camera in rig["cameras"]:
        if camera["name"] == "cam1":
            turn = Rotation.from_rotvec([0, 0.07, 0]).as_matrix()
            camera["R"], camera["t"] = (turn @ camera["R"]).tolist(), (turn @ camera["t"]).tolist()
    path.write_text(json.dumps(rig))
    return copied


def train(project: Path, *overrides: str) -> list[Event]:
    return run_take(project, *overrides, stages=("calibrate", "initialize", "train"))


def files_of(take: Take) -> dict[str, bytes]:
    files = [*(take.root / "train").rglob("*.safetensors"), take.camera_refinement, take.refined_rig]
    return {path.name: path.read_bytes() for path in files}


def test_they_are_kept_in_the_take_and_come_back_bit_for_bit(turned: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    take = Take.open(turned / "take")
    train(turned, *SCHEDULE)
    assert not take.refined_rig.exists(), "cameras from a file stay as they are"
    plain = take.trained_frame(0, 0).read_bytes()

    events = train(turned, *ALWAYS)
    report = read_model(take.camera_refinement, CameraRefinement)
    assert report.used
    assert report.after > report.before + 0.1
    assert set(report.cameras) == {f"cam{number}" for number in range(6)}, "held-out cameras are aligned"
    assert any(report.sentence in event.message for event in events if isinstance(event, Log))
    config = settings_in(turned, *ALWAYS)
    inputs = Inputs(take, config)
    trained, calibrated = inputs.trained_footage.rig["cam1"], inputs.calibrated_footage.rig["cam1"]
    assert np.allclose(trained.K, read_rig(take.refined_rig)["cam1"].K)
    assert not np.allclose(trained.center, calibrated.center)

    first = files_of(take)
    assert first["frame_000000.safetensors"] != plain

    def fails(*arguments: object, **options: object) -> None:
        raise Cancelled

    with monkeypatch.context() as patched:
        patched.setattr("v3studio.studio.training.refine_cameras", fails)
        with pytest.raises(Cancelled):
            train(turned, *ALWAYS, "run.seed=5")
    assert files_of(take) == first, "they stay until others are complete"

    # as after a kill while they are refined
    for path in (take.camera_refinement, take.trained_frame(0, 0), take.trained_frame(1, 3)):
        path.unlink()
    train(turned, *ALWAYS)
    assert files_of(take) == first

    # other cameras drop refined ones
    path = turned / "capture" / "cameras.json"
    given = path.read_text()
    path.write_text(given.replace("70.0", "70.5"))
    run(take, config, lambda event: None, stages=("calibrate",))
    assert not take.refined_rig.exists()
    path.write_text(given)

    train(turned, *SCHEDULE)
    assert not take.refined_rig.exists()
    assert not take.camera_refinement.exists()
    assert take.trained_frame(0, 0).read_bytes() == plain
    assert status(take, config)["train"].state == "stale"


def test_where_the_cameras_are_from_is_found_once(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Calibration finds it; naming the frames of a group again looks into no folder of the footage."""
    (copied / "capture" / "cameras.json").unlink()
    take = Take.open(copied / "take")
    inputs = Inputs(take, settings_in(copied, "capture.rig=auto"))
    scanned: list[str] = []
    scandir = os.scandir

    def counted(path: str | os.PathLike[str] = ".") -> Iterator[os.DirEntry[str]]:
        scanned.append(os.fspath(path))
        return scandir(path)

    keys = []
    for source in ("file", "board", "footage", "tie points"):
        take.calibration_report.write_text(json.dumps({"source": source}))
        keys.append(stage_named("train").group_code.group_key(inputs, inputs.groups[0]))
        with monkeypatch.context() as patched:
            patched.setattr(os, "scandir", counted)
            assert stage_named("train").group_code.group_key(inputs, inputs.groups[0]) == keys[-1]
    assert [path for path in scanned if path.startswith(str(copied / "capture"))] == []
    assert keys[0] == keys[1] != keys[2] == keys[3], "cameras that come from the footage are refined"


def test_cameras_that_gain_nothing_are_not_used(turned: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    take = Take.open(turned / "take")
    monkeypatch.setattr("v3studio.studio.training.camera_refinement.WORTH", 99.0)
    train(turned, *ALWAYS)
    report = read_model(take.camera_refinement, CameraRefinement)
    assert not report.used
    assert "does not help" in report.sentence
    assert not take.refined_rig.exists()
