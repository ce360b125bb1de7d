"""calibration.json of THuman4.0, calibration_full.json of AvatarReX, and others: one entry per camera, by name, with K,
R, T, `distCoeff`, `imgSize`. The pixel origin is OpenCV's, the center of the first pixel.
"""

from dataclasses import replace

from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import ignored_in_file, is_camera, keyed_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.json_types import JsonObject


def matches(file: CameraFile) -> bool:
    """Return whether a file has cameras by their names."""
    return any(map(is_camera, _by_name(file).values()))


def read(file: CameraFile) -> Rig:
    """Read the cameras."""
    entries = {name: entry for name, entry in _by_name(file).items() if isinstance(entry, dict)}
    beside = {key: value for key, value in file.json.items() if key not in entries and key != "cameras"}
    rig = keyed_rig(file.path.parent, list(entries.items()))
    return replace(rig, notes=(*rig.notes, *ignored_in_file(beside, ())))


def _by_name(file: CameraFile) -> JsonObject:
    """The objects of a file, or those in its `cameras`."""
    cameras = file.json_object.get("cameras")
    return cameras if isinstance(cameras, dict) else file.json_object
