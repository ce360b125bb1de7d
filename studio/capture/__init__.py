"""Footage: frames x cameras in files -> image, matte and camera of a view."""

from studio.capture.footage import Footage, View
from studio.capture.masks import Matter
from studio.capture.matting import FunctionMatter, MattingFunction
from studio.capture.opening import match_rig, open_footage, refuse_unknown_cameras
from studio.capture.spec import CaptureSpec

__all__ = [
    "CaptureSpec",
    "Footage",
    "FunctionMatter",
    "Matter",
    "MattingFunction",
    "View",
    "match_rig",
    "open_footage",
    "refuse_unknown_cameras",
]
