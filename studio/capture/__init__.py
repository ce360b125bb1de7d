"""Footage of a capture: images, mattes and cameras, by camera and frame."""

from typing import TYPE_CHECKING

from studio.lazy import lazy_exports

if TYPE_CHECKING:
    from studio.capture.checks import check_footage
    from studio.capture.footage import Footage, FootageView
    from studio.capture.mattes.matte_source import MatteSource
    from studio.capture.mattes.matting_function import FunctionMatteSource, MattingFunction
    from studio.capture.open_footage import (
        find_cameras,
        held_out_cameras,
        match_rig,
        open_footage,
        refuse_unknown_cameras,
    )
    from studio.capture.settings import CaptureSettings

__all__ = [
    "CaptureSettings",
    "Footage",
    "FootageView",
    "FunctionMatteSource",
    "MatteSource",
    "MattingFunction",
    "check_footage",
    "find_cameras",
    "held_out_cameras",
    "match_rig",
    "open_footage",
    "refuse_unknown_cameras",
]

lazy_exports(__name__)
