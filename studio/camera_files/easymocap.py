"""intri.yml and extri.yml of EasyMocap and EasyVolcap, written with OpenCV's FileStorage.

`names` lists the cameras. intri.yml has `K_<name>` (3 x 3) and `dist_<name>` or `D_<name>` (OpenCV order); extri.yml
has `R_<name>` (rotation vector), `Rot_<name>` (matrix) and `T_<name>`: x ~ K (R X + T) with OpenCV axes. The pixel
origin is OpenCV's, the center of the first pixel. Newer files also have the image size, `H_<name>` and `W_<name>`.
EasyVolcap adds times, bounds and a color matrix, and `rdist_<name>` for fisheye lenses.
"""

from pathlib import Path

import cv2
import numpy as np

from v3studio.studio.camera_files.common import check_expressible, need_both, no_cameras, write_atomic
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import KeyedForm, keyed_rig, normal_key
from v3studio.studio.camera_files.common.opencv_storage import read_storage
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import naming
from v3studio.studio.json_types import JsonObject

_INTRINSICS, _EXTRINSICS = "intri.yml", "extri.yml"
_LOWER_CASE = {"t": "time", "v": "view", "n": "near", "f": "far", "bounds": "bounds"}
"""EasyVolcap's keys that differ only in case from others."""


def read(file: CameraFile) -> Rig:
    """Read both files of a folder."""
    folder = file.path.parent
    need_both(folder, (_INTRINSICS, _EXTRINSICS), "EasyMocap")
    parts = [read_storage(folder / name) for name in (_INTRINSICS, _EXTRINSICS)]
    names = parts[0].get("names")
    if not isinstance(names, list) or not names:
        raise no_cameras("the list 'names' is missing or empty", folder / _INTRINSICS)
    cameras: list[tuple[str, JsonObject]] = [(str(name), {}) for name in names]
    for key, value in [pair for part in parts for pair in part.items()]:
        owners = [camera for camera in cameras if key.endswith(f"_{camera[0]}")]
        if owners:  # of the cameras 1 and left_1, K_left_1 belongs to the second
            max(owners, key=lambda camera: len(camera[0]))[1][key] = value
    with naming(folder):
        return keyed_rig(folder, cameras, KeyedForm(harmless=("view",), spelling=_spelling))


def _spelling(key: str, camera: str) -> str:
    own = key.removesuffix(f"_{camera}")
    return normal_key(_LOWER_CASE.get(own, own))


def write(rig: Rig, path: Path) -> None:
    """Write intri.yml and extri.yml, of which `path` is one, atomically."""
    intrinsics = ["%YAML:1.0", "---", "names:", *(f'   - "{camera.name}"' for camera in rig)]
    pose = list(intrinsics)
    for camera in rig:
        check_expressible(camera, "EasyMocap's file", 14)
        coefficients = np.pad(camera.distortion, (0, max(0, 5 - camera.distortion.size)))
        intrinsics += _matrix(f"K_{camera.name}", camera.cv2_K) + _matrix(f"dist_{camera.name}", coefficients[None])
        intrinsics += [f"H_{camera.name}: {camera.height}", f"W_{camera.name}: {camera.width}"]
        pose += _matrix(f"R_{camera.name}", cv2.Rodrigues(camera.rotation)[0])
        pose += _matrix(f"Rot_{camera.name}", camera.rotation)
        pose += _matrix(f"T_{camera.name}", camera.translation[:, None])
    for name, lines in ((_INTRINSICS, intrinsics), (_EXTRINSICS, pose)):
        write_atomic(path.parent / name, ("\n".join(lines) + "\n").encode())


def _matrix(key: str, value: np.ndarray) -> list[str]:
    """Lines of a matrix in OpenCV's FileStorage, with full precision."""
    data = ", ".join(repr(float(number)) for number in value.ravel())
    rows, columns = value.shape
    head = [f"{key}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
    return [*head, f"   data: [ {data} ]"]
