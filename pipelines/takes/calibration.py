"""calibrate/report.json: how the cameras were found."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

from pipelines.config.renamed import REPORT_KEYS
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
    """The take's calibration report, also with the keys of earlier versions; None if there is none.

    Raises:
        StudioError: it is not such a report (`take.damaged`).
    """
    path = take.calibration_report
    if not path.is_file():
        return None
    values = current_report(read_json(path))
    if isinstance(values, dict) and "reprojection" in values:
        return validated(path, values, CalibrationReport)
    return validated(path, values, CamerasFromFile)


def current_report(values: Any) -> Any:
    """JSON of a calibration report with current keys."""
    if not isinstance(values, dict):
        return values
    found = dict(values)
    for old, new in REPORT_KEYS.items():
        section, _, key = old.rpartition(".")
        if not section:
            found = {new if name == key else name: value for name, value in found.items()}
        elif isinstance(found.get(section), dict):
            found[section] = {new if name == key else name: value for name, value in found[section].items()}
    return found
