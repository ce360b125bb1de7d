"""annots.npy of ZJU-MoCap.

A pickled dictionary: `cams` has lists K (3 x 3), D (OpenCV distortion), R (3 x 3, world to camera) and T (3 x 1, in
millimeters), one entry per camera; `ims` has the names of the images of each frame, `Camera_B1/000000.jpg`. The pixel
origin is OpenCV's, the center of the first pixel.
"""

import pickle
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from v3studio.studio.camera_files.common import no_cameras
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import KeyedForm, keyed_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject
from v3studio.studio.validation import missing_key

_SAFE = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    *((f"numpy.{core}.multiarray", name) for core in ("core", "_core") for name in ("_reconstruct", "scalar")),
}


class _OnlyArrays(pickle.Unpickler):
    """Loads arrays, lists, dictionaries and plain values: a pickle may otherwise run any code."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _SAFE:
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"it contains {module}.{name}")


def read(file: CameraFile) -> Rig:
    """Read the cameras, in meters; image sizes come from the images next to the file."""
    content = _load(file.path)
    cams, frames = content.get("cams"), content.get("ims")
    if not isinstance(cams, dict) or not isinstance(frames, list) or not frames:
        raise no_cameras("the file has no 'cams' and 'ims'")
    images = frames[0].get("ims") if isinstance(frames[0], dict) else None
    lists: dict[str, Any] = {key: cams.get(key) for key in ("K", "D", "R", "T")}
    for key, value in lists.items():
        if not isinstance(value, list | np.ndarray):
            raise missing_key(key, "0")
    count = min(len(value) for value in lists.values())
    if images is None or not 0 < len(images) <= count:
        raise no_cameras(
            f"the file has {counted(count, 'camera')}, but {counted(len(images or ()), 'image')} per frame"
        )
    entries = []
    for index, image in enumerate(images):
        name = PurePosixPath(str(image).replace("\\", "/")).parts[0]
        entries.append((name, {key: np.asarray(value[index]).tolist() for key, value in lists.items()}))
    return keyed_rig(file.path.parent, entries, KeyedForm(unit=0.001))


def _load(path: Path) -> JsonObject:
    try:
        with path.open("rb") as file:
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            read(file)
            value = _OnlyArrays(file, encoding="latin1").load()
    except Exception as error:  # whatever a damaged pickle raises
        problem = f"not a dictionary saved by NumPy ({error})"
        raise StudioError("camera_file.syntax", problem, fix="Copy the file again.") from None
    value = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
    if not isinstance(value, dict):
        raise no_cameras("the file has no 'cams' and 'ims'")
    return value
