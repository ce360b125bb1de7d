"""Everything that was measured of the cameras of a take, and the verdict on each."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from v3studio.gui.drawing.palette import BAD, FAIR, GOOD, SECOND
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.results.stage_files import CheckedCameras, InitialPointsReport, checked_cameras
from v3studio.pipelines.takes.take import Take
from v3studio.studio.calibration.report import CalibrationReport
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import StudioError

WORSE, WRONG = 2.0, 3.0
"""Errors of a camera, relative to the median of all and to what is small, from which it is worse, and disagrees."""


class Verdict(Enum):
    """Whether a camera is right: in words, and as a color."""

    AGREES = ("agrees with the others", GOOD)
    WORSE = ("measured worse than the others: Report", FAIR)
    DISAGREES = ("disagrees with the others", BAD)
    FEW = ("too few matches to decide", FAIR)
    UNKNOWN = ("not checked yet: Initialize does that", SECOND)


@dataclass(frozen=True)
class MeasuredCameras:
    """What is known of the cameras. `mask_errors`: of each camera's masks, in the worst group if hulls have been
    compared with them, else that of the verdict. `apart`: the largest error of each camera, relative to what is
    usual."""

    checked: CheckedCameras = field(default_factory=lambda: CheckedCameras(None, None, None))
    mask_errors: Mapping[str, float] = field(default_factory=dict)
    apart: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def read(cls, take: Take, rig: Rig) -> "MeasuredCameras":
        """Read what is known of a take's cameras. Raises StudioError: `take.damaged`."""
        checked, group = checked_cameras(take), 0
        checks = checked.verdict.cameras if checked.verdict is not None else {}
        masks = {name: check.mask_error for name, check in checks.items() if check.mask_error is not None}
        with suppress(StudioError):  # damaged; Initialize shows the error
            while (path := take.initialize_group(group) / "report.json").is_file():
                for name, share in read_model(path, InitialPointsReport).disagreement.items():
                    masks[name] = max(masks.get(name, 0.0), share) if group else share
                group += 1
        cameras = checked.report.cameras if isinstance(checked.report, CalibrationReport) else {}
        focal = {camera.name: camera.fx / camera.width for camera in rig}
        usual = float(np.median(list(focal.values())))
        measured = (
            ({name: figures.mean for name, figures in cameras.items()}, 1.0),
            (masks, 0.12),
            ({name: abs(value / usual - 1) for name, value in focal.items()}, 0.1),
            ({name: 1 - check.fits for name, check in checks.items() if check.fits is not None}, 0.2),
        )
        apart: dict[str, float] = {}
        for errors, small in measured:
            most = max(float(np.median(list(errors.values()))), small) if errors else small
            for name, error in errors.items():
                apart[name] = max(apart.get(name, 0.0), error / most)
        return cls(checked, masks, apart)

    def verdict(self, name: str) -> Verdict:
        """Whether a camera is right."""
        verdict = self.checked.verdict
        if verdict is None:
            return Verdict.UNKNOWN
        if name in verdict.doubtful or (verdict.grade == "wrong" and "cameras" in verdict.blamed):
            return Verdict.DISAGREES
        far = self.apart.get(name, 0.0)
        if far > WORSE:
            return Verdict.DISAGREES if far > WRONG else Verdict.WORSE
        checked = verdict.cameras.get(name)
        decided = checked is not None and (checked.fits, checked.mask_error) != (None, None)
        return Verdict.AGREES if decided else Verdict.FEW
