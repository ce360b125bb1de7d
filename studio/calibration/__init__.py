"""Cameras from images, and how good they are."""

from studio.calibration.alignment import RigDifference, Similarity, align_points, align_rigs, compare_rigs, floor_world
from studio.calibration.manual.bundle_adjustment import Accuracy
from studio.calibration.manual.file import TiePoint, read_tie_points, write_tie_points
from studio.calibration.manual.solve import TieSettings, calibrate_from_tie_points
from studio.calibration.result import CalibrationResult, reprojection_report
from studio.calibration.sfm.job import SfmSettings
from studio.calibration.sfm.reconstruct import calibrate_from_images
from studio.calibration.target.pattern import Board, View
from studio.calibration.target.pdf import PAPERS, write_board_pdf
from studio.calibration.target.rig import BoardSettings, calibrate_from_boards, calibrate_lenses, detect_boards

__all__ = [
    "PAPERS",
    "Accuracy",
    "Board",
    "BoardSettings",
    "CalibrationResult",
    "RigDifference",
    "SfmSettings",
    "Similarity",
    "TiePoint",
    "TieSettings",
    "View",
    "align_points",
    "align_rigs",
    "calibrate_from_boards",
    "calibrate_from_images",
    "calibrate_from_tie_points",
    "calibrate_lenses",
    "compare_rigs",
    "detect_boards",
    "floor_world",
    "read_tie_points",
    "reprojection_report",
    "write_board_pdf",
    "write_tie_points",
]
