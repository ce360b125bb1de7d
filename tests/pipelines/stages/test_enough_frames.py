"""Calibration from footage takes more frames until they are enough."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.stages import calibrate
from pipelines.stages.reporter import StageReporter
from pipelines.takes.checked_cameras import checked_cameras
from studio.calibration import CalibrationResult, reprojection_report
from studio.calibration.verdict import RigVerdict
from studio.cameras import Rig
from studio.errors import StudioError
from tests.pipelines.stages.test_known_cameras import context, rig
from tests.support.errors import refuses

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
    monkeypatch.setattr("studio.calibration.calibrate_from_images", solver, raising=False)
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
    monkeypatch.setattr("studio.calibration.calibrate_from_images", solver, raising=False)
    monkeypatch.setattr(calibrate, "judge_by_images", lambda *given, **more: WRONG)
    with refuses("calibration.unregistered"):
        calibrate.run(context(tmp_path / "set", filmed=12, frame_count=3), StageReporter("calibrate"), None)
    assert solver.asked == [3]
    made = context(tmp_path / "short", filmed=2)
    assert calibrate.run(made, StageReporter("calibrate"), None).grade == "wrong"
    assert solver.asked == [3, 1, 2]
