"""Cameras from images, and how good they are."""

from studio.calibration.gauge import RigDifference, Similarity, align_points, align_rigs, compare_rigs
from studio.calibration.result import CalibrationResult, reprojection_report
from studio.calibration.sfm import SfmSettings, calibrate_from_images

__all__ = [
    "CalibrationResult",
    "RigDifference",
    "SfmSettings",
    "Similarity",
    "align_points",
    "align_rigs",
    "calibrate_from_images",
    "compare_rigs",
    "reprojection_report",
]
