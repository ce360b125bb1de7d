"""intri.yml and extri.yml of EasyMocap and EasyVolcap, written with OpenCV's FileStorage.

`names` lists the cameras. intri.yml has `K_<name>` (3 x 3) and `dist_<name>` or `D_<name>` (OpenCV order); extri.yml
has `R_<name>` (rotation vector), `Rot_<name>` (matrix) and `T_<name>`: x ~ K (R X + T) with OpenCV axes. The pixel
origin is OpenCV's, the center of the first pixel. Newer files also have the image size, `H_<name>` and `W_<name>`.
EasyVolcap adds times, bounds and a color matrix, and `rdist_<name>` for fisheye lenses.
"""

from pathlib import Path

import numpy as np

from studio.camera_files.common import need_both, no_cameras, write_atomic
from studio.camera_files.keyed import KeyedForm, keyed_rig, normal_key
from studio.camera_files.nearby import size_nearby
from studio.camera_files.opencv_storage import read_storage
from studio.cameras import Rig
from studio.json_types import JsonObject

INTRINSICS, EXTRINSICS = "intri.yml", "extri.yml"
_LOWER_CASE = {"t": "time", "v": "view", "n": "near", "f": "far", "bounds": "bounds"}
"""EasyVolcap's keys that differ only in case from others."""


def read_easymocap(folder: Path) -> Rig:
    """Read both files of a folder."""
    need_both(folder, (INTRINSICS, EXTRINSICS), "EasyMocap")
    files = [read_storage(folder / name) for name in (INTRINSICS, EXTRINSICS)]
    names = files[0].get("names")
    if not isinstance(names, list) or not names:
        raise no_cameras("the list 'names' is missing or empty", folder / INTRINSICS)
    cameras: list[tuple[str, JsonObject]] = [(str(name), {}) for name in names]
    for key, value in [pair for file in files for pair in file.items()]:
        owners = [camera for camera in cameras if key.endswith(f"_{camera[0]}")]
        if owners:  # of the cameras 1 and left_1, K_left_1 belongs to the second
            max(owners, key=lambda camera: len(camera[0]))[1][key] = value
    form = KeyedForm(harmless=("view",), spelling=_spelling, size_of=lambda name: size_nearby(folder, name, name))
    return keyed_rig(folder, cameras, form)


def _spelling(key: str, camera: str) -> str:
    own = key.removesuffix(f"_{camera}")
    return normal_key(_LOWER_CASE.get(own, own))


def write_easymocap(rig: Rig, folder: Path) -> None:
    """Write intri.yml and extri.yml."""
    import cv2

    intrinsics = _Text([camera.name for camera in rig])
    pose = _Text([camera.name for camera in rig])
    for camera in rig:
        coefficients = np.zeros(max(5, camera.distortion.size))
        coefficients[: camera.distortion.size] = camera.distortion
        intrinsics.matrix(f"K_{camera.name}", camera.cv2_K)
        intrinsics.matrix(f"dist_{camera.name}", coefficients[None])
        intrinsics.lines += [f"H_{camera.name}: {camera.height}", f"W_{camera.name}: {camera.width}"]
        pose.matrix(f"R_{camera.name}", cv2.Rodrigues(camera.rotation)[0])
        pose.matrix(f"Rot_{camera.name}", camera.rotation)
        pose.matrix(f"T_{camera.name}", camera.translation[:, None])
    write_atomic(folder / INTRINSICS, intrinsics.bytes())
    write_atomic(folder / EXTRINSICS, pose.bytes())


class _Text:
    """Text in the format of OpenCV's FileStorage, with full precision."""

    def __init__(self, names: list[str]) -> None:
        self.lines = ["%YAML:1.0", "---", "names:", *(f'   - "{name}"' for name in names)]

    def matrix(self, key: str, value: np.ndarray) -> None:
        data = ", ".join(repr(float(number)) for number in value.ravel())
        rows, columns = value.shape
        self.lines += [f"{key}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
        self.lines += [f"   data: [ {data} ]"]

    def bytes(self) -> bytes:
        """The content of the file."""
        return ("\n".join(self.lines) + "\n").encode()
