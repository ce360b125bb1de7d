"""Footage of a capture: images, masks and cameras, by camera and frame."""

from typing import TYPE_CHECKING

from studio.lazy import lazy_exports

if TYPE_CHECKING:
    from studio.capture.checks import check_footage
    from studio.capture.footage import Footage, FootageView
    from studio.capture.open_footage import (
        find_cameras,
        held_out_cameras,
        match_rig,
        open_footage,
        refuse_unknown_cameras,
    )
    from studio.capture.settings import CaptureSettings
    from studio.masks.mask_source import MaskSource
    from studio.masks.matting_function import FunctionMaskSource, MattingFunction

__all__ = [
    "CaptureSettings",
    "Footage",
    "FootageView",
    "FunctionMaskSource",
    "MaskSource",
    "MattingFunction",
    "check_footage",
    "find_cameras",
    "held_out_cameras",
    "match_rig",
    "open_footage",
    "refuse_unknown_cameras",
]

lazy_exports(__name__)
