"""calibrate/report.json: written and read by the same models."""

from pathlib import Path

import numpy as np
import pytest

from pipelines.takes.atomic_files import read_json, write_model
from pipelines.takes.stage_files import CamerasFromFile, read_cameras_report
from pipelines.takes.take import Take
from studio.calibration import reprojection_report
from studio.calibration.report import CalibrationReport, IntrinsicsReport, TargetReport
from tests.support.rigs import ring


@pytest.fixture
def take(tmp_path: Path) -> Take:
    return Take.create(tmp_path / "take")


def solved() -> CalibrationReport:
    rig = ring(3)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    seen = {camera.name: np.column_stack([np.arange(20), camera.project(points)[0]]) for camera in rig}
    target = TargetReport(
        sync_frames=4, views=8, corners=100, views_left_out=0, corners_left_out=1, shared={"cam0 cam1": 4}
    )
    intrinsics = {"cam0": IntrinsicsReport(mean=0.1, median=0.1, p95=0.2, views=5)}
    update = {"target": target, "intrinsics": intrinsics, "known_intrinsics": ["cam0"], "match_inlier_ratio": 0.9}
    return reprojection_report(rig, points, seen).model_copy(update={**update, "sync_frames": 4, "source": "board"})


def test_what_is_written_is_read(take: Take) -> None:
    assert read_cameras_report(take) is None
    for report in (solved(), CamerasFromFile(source="file", file="rig.json")):
        write_model(take.calibration_report, report)
        assert read_cameras_report(take) == report
    assert read_json(take.calibration_report) == {"source": "file", "file": "rig.json"}
