"""train_meta.json and test_meta.json of Dynamic 3D Gaussians.

Lists with one entry per frame, each with one per camera: `k` (3 x 3), `w2c` (4 x 4, OpenCV axes), `fn` (path of the
image, `CAMERA/FRAME.jpg`) and `cam_id`; `w` and `h` are for all. The images are undistorted, and the program renders
with the principal point relative to the image corner. The cameras of test_meta.json are meant for evaluation.
"""

from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from v3studio.studio.camera_files.common import no_cameras, read_json
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import NO_DISTORTION, KeyedForm, keyed_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.json_types import JsonObject
from v3studio.studio.validation import missing_key

_TRAIN, _TEST = "train_meta.json", "test_meta.json"
_LISTS = ("k", "w2c", "fn", "cam_id")
_KNOWN = {*_LISTS, "w", "h"}


def matches(file: CameraFile) -> bool:
    """Return whether a file has this form."""
    return {"w2c", "fn"} <= file.json_object.keys()


def read(file: CameraFile) -> Rig:
    """Read the cameras of both files in the folder, in the order of the training file, then the test file."""
    path = file.path
    names = [name for name in (_TRAIN, _TEST) if (path.parent / name).is_file()]
    files = [path.parent / name for name in names] if path.name in (_TRAIN, _TEST) else [path]
    rigs = [_cameras(part) for part in files]
    test = [camera.name for part, rig in zip(files, rigs, strict=True) if part.name == _TEST for camera in rig]
    cameras = tuple(camera for rig in rigs for camera in rig)
    return Rig(cameras, (NO_DISTORTION,), for_evaluation=tuple(test) if len(rigs) > 1 else ())


def _cameras(path: Path) -> Rig:
    content = read_json(path)
    with naming(path):
        unknown = sorted(set(content) - _KNOWN)
        if unknown:
            problem = f"the key '{unknown[0]}' is not known and may be the lens distortion"
            fix = "Delete it if it does not belong to the cameras."
            raise StudioError("camera.unknown_key", problem, value=unknown[0], fix=fix, key=unknown[0])
        lists: dict[str, list[list[Any]]] = {}
        for key in _LISTS:
            value = content.get(key)
            if key == "cam_id" and value is None:
                continue
            if value == []:
                raise no_cameras(f"the list '{key}' is empty")
            if not isinstance(value, list) or not all(isinstance(row, list) for row in value):
                raise missing_key(key, "0")
            lists[key] = value
        if len({tuple(len(row) for row in value) for value in lists.values()}) > 1:
            raise no_cameras("the lists " + ", ".join(f"'{key}'" for key in lists) + " differ in length")
        cameras: dict[str, JsonObject] = {}
        for files, Ks, poses in zip(lists["fn"], lists["k"], lists["w2c"], strict=True):
            for file, K, pose in zip(files, Ks, poses, strict=True):
                _add(cameras, file, {"k": K, "w2c": pose})
        size: JsonObject = {key: content[key] for key in ("w", "h") if key in content}
        entries = [(name, {**entry, **size}) for name, entry in cameras.items()]
        return replace(keyed_rig(path.parent, entries, KeyedForm(corner=True)), notes=())


def _add(cameras: dict[str, JsonObject], file: Any, entry: JsonObject) -> None:
    parts = PurePosixPath(str(file).replace("\\", "/")).parts
    name = parts[-2] if len(parts) > 1 else PurePosixPath(str(file)).stem
    before = cameras.setdefault(name, entry)
    if before is not entry and before != entry and not np.allclose(_numbers(before), _numbers(entry), atol=1e-6):
        problem = f"Camera '{name}' has different values in '{file}' than in earlier frames; cameras must not move"
        raise StudioError("camera.moves", problem, value=str(file), fix="Use footage of fixed cameras.", camera=name)


def _numbers(entry: JsonObject) -> np.ndarray:
    try:
        return np.concatenate([np.array(entry[key], np.float64).ravel() for key in ("k", "w2c")])
    except (TypeError, ValueError):
        return np.full(1, np.nan)  # not equal to anything; named when the camera is read
