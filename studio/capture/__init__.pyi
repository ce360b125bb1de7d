from .checks import check_footage
from .footage import Footage, FootageView
from .matching import match_rig, rig_of_footage
from .open_footage import find_cameras, held_out_cameras, open_footage, refuse_unknown_cameras, suggested_held_out
from .settings import CaptureSettings

__all__ = [
    "CaptureSettings",
    "Footage",
    "FootageView",
    "check_footage",
    "find_cameras",
    "held_out_cameras",
    "match_rig",
    "open_footage",
    "refuse_unknown_cameras",
    "rig_of_footage",
    "suggested_held_out",
]
