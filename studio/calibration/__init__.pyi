from .alignment import RigDifference, align_points, align_rigs, compare_rigs, floor_world
from .manual.file import TiePoint, read_tie_points, write_tie_points
from .manual.solve import calibrate_from_tie_points
from .result import CalibrationResult, reprojection_report
from .settings import CalibrateSettings
from .sfm.reconstruct import calibrate_from_images
from .target.pattern import CalibrationTarget, TargetObservation
from .target.pdf import PAPERS, write_target_pdf
from .target.rig import calibrate_from_target, calibrate_intrinsics, detect_target

__all__ = [
    "PAPERS",
    "CalibrateSettings",
    "CalibrationResult",
    "CalibrationTarget",
    "RigDifference",
    "TargetObservation",
    "TiePoint",
    "align_points",
    "align_rigs",
    "calibrate_from_images",
    "calibrate_from_target",
    "calibrate_from_tie_points",
    "calibrate_intrinsics",
    "compare_rigs",
    "detect_target",
    "floor_world",
    "read_tie_points",
    "reprojection_report",
    "write_target_pdf",
    "write_tie_points",
]
