import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.support.errors import refuses
from tests.support.tiny_capture import run_take, settings_in
from v3studio.pipelines.config import Config
from v3studio.pipelines.runs.runner import status
from v3studio.pipelines.stages import calibrate
from v3studio.pipelines.stages.calibrate_plan import frames_to_try
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.known_cameras import focal_lengths, known_cameras
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.target import calibrate_with_target
from v3studio.pipelines.takes.results.stage_files import checked_cameras
from v3studio.pipelines.takes.take import Take
from v3studio.studio.calibration import CalibrationResult, align_rigs, reprojection_report
from v3studio.studio.calibration.report import RigVerdict
from v3studio.studio.calibration.settings import CalibrateSettings
from v3studio.studio.camera_files import read_rig, write_rig
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.errors import StudioError


def context(tmp_path: Path, filmed: int = 1, suffix: str = "png", **settings) -> Inputs:
    for name in ("a", "b"):
        folder = tmp_path / "capture" / "images" / name
        folder.mkdir(parents=True, exist_ok=True)
        for frame in range(filmed):
            picture = Image.new("RGB", (80, 60), (frame, 90, 90))
            exif = Image.Exif()
            exif[0xA405] = 50  # focal length on 35 mm film
            picture.save(folder / f"{frame}.{suffix}", **({"exif": exif} if suffix == "jpg" else {}))
    capture = {"root": str(tmp_path / "capture"), "rig": None, "masks": "none"}
    config = Config.model_validate({"capture": capture, "calibrate": settings})
    return Inputs(Take.create(tmp_path / "take"), config)


def rig(names: tuple[str, ...], width: int = 160) -> Rig:
    K = np.array([[200.0, 0, width / 2], [0, 200, width * 3 / 8], [0, 0, 1]])
    return Rig(tuple(Camera(name, width, width * 3 // 4, K, np.eye(4)) for name in names))


def known_in(made: Inputs) -> Rig | None:
    return known_cameras(made.config.calibrate, made.raw_footage)


def test_an_older_solution_is_brought_to_the_footages_size(tmp_path: Path) -> None:
    made = context(tmp_path, known_cameras="old.json")
    write_rig(rig(("a.png", "b.png")), tmp_path / "capture" / "old.json")
    found = known_in(made)
    assert found.names == ("a", "b")
    assert (found["a"].width, found["a"].fx, found["a"].cx) == (80, 100, 40)
    write_rig(rig(("a",)), tmp_path / "capture" / "old.json")
    with refuses("calibration.camera_missing", value="b", known=("a",)):
        known_in(made)
    (tmp_path / "capture" / "old.json").unlink()
    with refuses("settings.file_not_found", file=tmp_path / "capture" / "old.json", setting="calibrate.known_cameras"):
        known_in(made)
    with refuses("settings.missing", setting="calibrate.known_cameras"):
        known_in(context(tmp_path, known="initial_poses"))
    assert known_in(context(tmp_path)) is None


def test_a_camera_file_of_another_shape_is_told_by_calibrate(tmp_path: Path) -> None:
    """A rig of the same aspect ratio is scaled by the footage and written unchanged; another one needs a size rule."""
    made = context(tmp_path)
    file = tmp_path / "capture" / "given.json"

    def calibrated(width: int, **capture) -> Rig:
        K = np.array([[100.0, 0, width / 2], [0, 100, 30], [0, 0, 1]])
        write_rig(Rig(tuple(Camera(name, width, 60, K, np.eye(4)) for name in ("a", "b"))), file)
        section = made.config.capture.model_copy(update={"rig": "given.json", **capture})
        fresh = Inputs(made.take, made.config.model_copy(update={"capture": section}))
        calibrate.run(fresh, StageReporter("calibrate"), None)
        return read_rig(made.take.rig)

    with pytest.raises(StudioError, match=r"Camera 'a': the aspect ratio of the footage, 80x60.*capture\.size_rule"):
        calibrated(88)
    assert calibrated(88, size_rule="crop")["a"].width == 88
    assert calibrated(80)["b"].width == 80


def test_looking_at_the_room_needs_masks(tmp_path: Path) -> None:
    made = context(tmp_path, look_at="room")
    with refuses("settings.conflict", value="room", setting="calibrate.look_at", other="capture.masks"):
        calibrate.run(made, StageReporter("calibrate"), None)


def test_focal_lengths_from_exif(tmp_path: Path) -> None:
    made = context(tmp_path, suffix="jpg")
    found = focal_lengths(made.raw_footage, 0)
    assert set(found) == {"a", "b"}
    assert found["a"] == pytest.approx(50 / 35 * 80, rel=0.05)
    assert focal_lengths(context(tmp_path / "other").raw_footage, 0) == {}


def test_board_images_are_shifted_as_the_footage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = context(tmp_path, filmed=6)
    capture = made.config.capture.replace(offsets={"b": 2})
    settings = CalibrateSettings(board_images="images/{camera}/{frame}.png")
    first = {}

    def detect(cameras: dict[str, Any], *_: object) -> None:
        first.update({name: int(read(1)[0, 0, 0]) for name, read in cameras.items()})
        raise StudioError("stop", "")

    monkeypatch.setattr("v3studio.studio.calibration.detect_target", detect)
    with refuses("stop"):
        calibrate_with_target(settings, capture, ("a", "b"), 1, StageReporter("calibrate"))
    assert first == {"a": 1, "b": 3}


def test_which_frames() -> None:
    def tried(**settings: int) -> list[list[int]]:
        return frames_to_try(CalibrateSettings(**settings), range(12))

    assert tried() == [[0], [2, 6, 10], [1, 3, 5, 7, 9, 11], list(range(12))]
    assert [tried(frame_count=count) for count in (1, 3, 50)] == [[[0]], [[2, 6, 10]], [list(range(12))]]
    assert tried(frame=7) == [[7]]
    with refuses("settings.conflict", setting="calibrate.frame", other="calibrate.frame_count"):
        tried(frame=1, frame_count=2)


GOOD = RigVerdict(grade="good", reason="The matches fit.")
WRONG = RigVerdict(grade="wrong", reason="The rig is folded.", fix="Use a board.", blamed="cameras")


class Solver:
    """Stands for structure from motion, which it asks for the number of frames only."""

    def __init__(self, outcomes: dict[int, int | str]) -> None:
        self.outcomes, self.asked = outcomes, list[int]()

    def __call__(self, images: dict[str, list], masks: object, **options: Any) -> CalibrationResult:
        self.asked.append(len(images["a"]))
        outcome = self.outcomes[self.asked[-1]]
        if isinstance(outcome, str):
            raise StudioError(outcome, "a camera is not registered")
        cameras = Rig(tuple(camera.resized(80, 60) for camera in rig(("a", "b"))))
        points = np.random.default_rng(0).uniform([-0.1, -0.1, 2], [0.1, 0.1, 3], (outcome, 3))
        seen = {one.name: np.column_stack([np.arange(outcome), one.project(points)[0]]) for one in cameras}
        colors = np.zeros((outcome, 3), np.uint8)
        return CalibrationResult(cameras, points, colors, reprojection_report(cameras, points, seen))


def test_until_all_are_registered_and_right(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    solver = Solver({1: "calibration.unregistered", 3: 50, 6: 400, 12: 500})
    verdicts = iter([WRONG, GOOD])
    monkeypatch.setattr("v3studio.studio.calibration.calibrate_from_images", solver, raising=False)
    monkeypatch.setattr(calibrate, "judge_by_images", lambda *given, **more: next(verdicts))
    made = context(tmp_path, filmed=12)
    events: list = []
    summary = calibrate.run(made, StageReporter("calibrate", events.append), None)
    assert solver.asked == [1, 3, 6, 12]
    checked = checked_cameras(made.take)
    assert checked.verdict == GOOD
    assert checked.report is not None
    assert summary.grade == "good"
    told = " ".join(getattr(event, "message", "") for event in events)
    for reason in ("a camera is not registered", "fewer than 300 points", "The rig is folded"):
        assert reason in told


def test_what_is_set_is_taken_and_the_last_attempt_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    solver = Solver({3: "calibration.unregistered", 1: 50, 2: 60})
    monkeypatch.setattr("v3studio.studio.calibration.calibrate_from_images", solver, raising=False)
    monkeypatch.setattr(calibrate, "judge_by_images", lambda *given, **more: WRONG)
    with refuses("calibration.unregistered"):
        calibrate.run(context(tmp_path / "set", filmed=12, frame_count=3), StageReporter("calibrate"), None)
    assert solver.asked == [3]
    made = context(tmp_path / "short", filmed=2)
    assert calibrate.run(made, StageReporter("calibrate"), None).grade == "wrong"
    assert solver.asked == [3, 1, 2]


def test_a_take_is_calibrated_from_tie_points(project: Path) -> None:
    truth = read_rig(project / "capture" / "cameras.json")
    positions = np.random.default_rng(0).uniform(-0.6, 0.6, (20, 3))
    points = {
        f"p{number:02d}": {"pixels": {camera.name: camera.project(position[None])[0][0].tolist() for camera in truth}}
        for number, position in enumerate(positions)
    }
    (project / "capture" / "points.yaml").write_text(json.dumps({"points": points}))
    options = ("capture.rig=null", "calibrate.tie_points=points.yaml", "calibrate.known_cameras=cameras.json")
    run_take(project, *options, stages=("calibrate",))
    take = Take.open(project / "take")
    found = read_rig(take.rig)
    aligned = align_rigs(found, truth).rig(found)
    for camera in truth:
        assert np.linalg.norm(aligned[camera.name].center - camera.center) < 1e-3
    assert status(take, settings_in(project, *options))["calibrate"].state == "done"
