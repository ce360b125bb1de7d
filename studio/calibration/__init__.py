"""Camera calibration from images, targets or marked points, with a quality report."""

from typing import TYPE_CHECKING

from studio.lazy import lazy_exports

if TYPE_CHECKING:
    from studio.calibration.alignment import (
        RigDifference,
        Similarity,
        align_points,
        align_rigs,
        compare_rigs,
        floor_world,
    )
    from studio.calibration.manual.file import TiePoint, read_tie_points, write_tie_points
    from studio.calibration.manual.solve import calibrate_from_tie_points
    from studio.calibration.result import CalibrationResult, reprojection_report
    from studio.calibration.settings import CalibrateSettings
    from studio.calibration.sfm.reconstruct import calibrate_from_images
    from studio.calibration.target.pattern import CalibrationTarget, TargetObservation
    from studio.calibration.target.pdf import PAPERS, write_target_pdf
    from studio.calibration.target.rig import calibrate_from_target, calibrate_lenses, detect_target

__all__ = [
    "PAPERS",
    "CalibrateSettings",
    "CalibrationResult",
    "CalibrationTarget",
    "RigDifference",
    "Similarity",
    "TargetObservation",
    "TiePoint",
    "align_points",
    "align_rigs",
    "calibrate_from_images",
    "calibrate_from_target",
    "calibrate_from_tie_points",
    "calibrate_lenses",
    "compare_rigs",
    "detect_target",
    "floor_world",
    "read_tie_points",
    "reprojection_report",
    "write_target_pdf",
    "write_tie_points",
]

lazy_exports(__name__)
