from .checks import check_footage
from .footage import Footage, FootageView
from .open_footage import (
    cameras_left_out,
    find_cameras,
    held_out_cameras,
    match_rig,
    open_footage,
    refuse_unknown_cameras,
    rig_notes,
)
from .settings import CaptureSettings

__all__ = [
    "CaptureSettings",
    "Footage",
    "FootageView",
    "cameras_left_out",
    "check_footage",
    "find_cameras",
    "held_out_cameras",
    "match_rig",
    "open_footage",
    "refuse_unknown_cameras",
    "rig_notes",
]
