"""Footage: frames x cameras in files -> image, matte and camera of a view."""

from studio.capture.checks import check_footage
from studio.capture.footage import Footage, FootageView
from studio.capture.mattes.matte_source import MatteSource
from studio.capture.mattes.matting_function import FunctionMatteSource, MattingFunction
from studio.capture.open_footage import match_rig, open_footage, refuse_unknown_cameras
from studio.capture.spec import CaptureSpec

__all__ = [
    "CaptureSpec",
    "Footage",
    "FootageView",
    "FunctionMatteSource",
    "MatteSource",
    "MattingFunction",
    "check_footage",
    "match_rig",
    "open_footage",
    "refuse_unknown_cameras",
]
