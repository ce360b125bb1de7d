"""calibration.json of THuman4.0 and calibration_full.json of AvatarReX.

An object with one entry per camera: K (3 x 3), R (3 x 3, world to camera) and T, as nested or flat lists, in meters;
some files also have `distCoeff` (OpenCV) and `imgSize` or `W` and `H`. The pixel origin is OpenCV's, the center of the
first pixel.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from studio.camera_files.common import naming, wrong_shape
from studio.camera_files.nearby import size_nearby
from studio.cameras import Camera, Rig
from studio.json_types import JsonObject
from studio.validation import array, check_finite, missing_key, whole


def is_thuman(values: JsonObject) -> bool:
    """Whether every entry of the JSON object is a camera with K, R and T."""
    return bool(values) and all(isinstance(value, dict) and {"K", "R", "T"} <= set(value) for value in values.values())


def rig_from_thuman(path: Path, values: JsonObject) -> Rig:
    """A rig from the JSON object in the file; sizes that it does not have come from the footage next to it.

    Raises:
        StudioError: a value is missing or invalid, or there is no footage (camera.*).
    """
    with naming(path):
        return Rig(tuple(_camera(path.parent, name, entry) for name, entry in values.items()))


def _camera(folder: Path, name: str, entry: JsonObject) -> Camera:
    def numbers(key: str, count: int, shape: tuple[int, ...]) -> np.ndarray:
        value = array(entry[key], key, name)
        if value.size != count:
            raise wrong_shape(key, name, value.shape, (shape,))
        check_finite(value, key, name)
        return value.reshape(shape)

    K = numbers("K", 9, (3, 3)).copy()
    K[:2, 2] += 0.5
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = numbers("R", 9, (3, 3)), numbers("T", 3, (3,))
    distortion = array(entry.get("distCoeff", []), "distCoeff", name).ravel()
    check_finite(distortion, "distCoeff", name)
    size = entry.get("imgSize")
    if isinstance(size, list) and len(size) == 2:
        width, height = (whole({"imgSize": part}, "imgSize", name) for part in size)
    elif "W" in entry and "H" in entry:
        width, height = whole(entry, "W", name), whole(entry, "H", name)
    else:
        width, height = size_nearby(folder, name, name)
    if min(width, height) < 1:
        raise missing_key("imgSize", name)
    return Camera(name, width, height, K, pose, distortion if distortion.any() else np.zeros(0))
