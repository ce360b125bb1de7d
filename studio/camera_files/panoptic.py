"""calibration_*.json of CMU Panoptic.

A list `cameras` as in cameras.json (`studio.camera_files.rig_json`), with `resolution` and `distCoef`, in centimeters.
The pixel origin is OpenCV's, the center of the first pixel.
"""

from dataclasses import replace

from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import KeyedForm, keyed_rig
from v3studio.studio.camera_files.rig_json import listed_cameras
from v3studio.studio.cameras import Rig

_FORM = KeyedForm(unit=0.01, harmless=("calibDataSource",))
_UNIT = "CMU Panoptic: centimeters are converted to meters."


def matches(file: CameraFile) -> bool:
    """Return whether a file has this form."""
    content = file.json_object
    cameras = content.get("cameras")
    if not isinstance(cameras, list):
        return False
    places = [isinstance(entry, dict) and {"panel", "node"} <= entry.keys() for entry in cameras]
    return "calibDataSource" in content or (bool(places) and all(places))


def read(file: CameraFile) -> Rig:
    """Read the cameras, in meters."""
    entries, notes = listed_cameras(file.json_object)
    rig = keyed_rig(file.path.parent, entries, _FORM)
    return replace(rig, notes=(*rig.notes, *notes, _UNIT))
