"""calibrate/report.json: how the cameras were found."""

from __future__ import annotations

from typing import Literal, TypeAlias

from pipelines.takes.atomic_files import Result, read_json, validated
from pipelines.takes.take import Take
from studio.calibration.report import CalibrationReport


class CamerasFromFile(Result):
    """The report if the cameras are from a calibration file."""

    source: Literal["file"] = "file"
    file: str
    """The calibration file."""


CamerasReport: TypeAlias = CalibrationReport | CamerasFromFile


def read_cameras_report(take: Take) -> CamerasReport | None:
    """The take's calibration report; None if there is none.

    Raises:
        StudioError: it is not such a report (`take.damaged`).
    """
    path = take.calibration_report
    if not path.is_file():
        return None
    values = read_json(path)
    if isinstance(values, dict) and "reprojection" in values:
        return validated(path, values, CalibrationReport)
    return validated(path, values, CamerasFromFile)
