"""calibration.json of THuman4.0, calibration_full.json of AvatarReX, and others: one entry per camera, by name, with K,
R, T, `distCoeff`, `imgSize`. The pixel origin is OpenCV's, the center of the first pixel.
"""

from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import is_camera, keyed_rig
from v3studio.studio.cameras import Rig


def matches(file: CameraFile) -> bool:
    """Return whether all values in a file are objects, and some are cameras."""
    entries = file.json_object.values()
    return any(map(is_camera, entries)) and all(isinstance(entry, dict) for entry in entries)


def read(file: CameraFile) -> Rig:
    """Read the cameras."""
    return keyed_rig(file.path.parent, list(file.json.items()))
