"""Cameras from boards and marked points, and their comparison. `v3studio.calibrate_from_images` needs neither."""

from v3studio.studio.calibration import (
    CalibrationTarget,
    RigDifference,
    TargetObservation,
    TiePoint,
    align_rigs,
    calibrate_from_target,
    calibrate_from_tie_points,
    calibrate_intrinsics,
    compare_rigs,
    detect_target,
    read_tie_points,
    write_target_pdf,
    write_tie_points,
)

__all__ = [
    "CalibrationTarget",
    "RigDifference",
    "TargetObservation",
    "TiePoint",
    "align_rigs",
    "calibrate_from_target",
    "calibrate_from_tie_points",
    "calibrate_intrinsics",
    "compare_rigs",
    "detect_target",
    "read_tie_points",
    "write_target_pdf",
    "write_tie_points",
]
