"""Cameras from images, and how good they are."""

from studio.calibration.board import Board, View
from studio.calibration.board_pdf import PAPERS, write_board_pdf
from studio.calibration.board_rig import BoardSettings, calibrate_from_boards, calibrate_lenses, detect_boards
from studio.calibration.gauge import RigDifference, Similarity, align_points, align_rigs, compare_rigs, floor_world
from studio.calibration.result import CalibrationResult, reprojection_report
from studio.calibration.sfm import calibrate_from_images
from studio.calibration.sfm_job import SfmSettings

__all__ = [
    "PAPERS",
    "Board",
    "BoardSettings",
    "CalibrationResult",
    "RigDifference",
    "SfmSettings",
    "Similarity",
    "View",
    "align_points",
    "align_rigs",
    "calibrate_from_boards",
    "calibrate_from_images",
    "calibrate_lenses",
    "compare_rigs",
    "detect_boards",
    "floor_world",
    "reprojection_report",
    "write_board_pdf",
]
