"""intri.yml and extri.yml of EasyMocap, written with OpenCV's FileStorage.

`names` lists the cameras. intri.yml has `K_<name>` (3 x 3) and `dist_<name>` (OpenCV order); extri.yml has `R_<name>`
(rotation vector), `Rot_<name>` (matrix) and `T_<name>`: x ~ K (R X + T) with OpenCV axes. The pixel origin is OpenCV's,
the center of the first pixel. Newer files also have the image size, `H_<name>` and `W_<name>`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from studio.camera_files.common import naming, write_atomic
from studio.camera_files.nearby import size_nearby
from studio.camera_files.opencv_storage import Storage
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.validation import missing_key

INTRINSICS, EXTRINSICS = "intri.yml", "extri.yml"


def read_easymocap(folder: Path) -> Rig:
    """Read both files of a folder.

    Raises:
        StudioError: a file is missing or unreadable (camera_file.*), or a camera is invalid or its image size is
            unknown (camera.*).
    """
    for name in (INTRINSICS, EXTRINSICS):
        if not (folder / name).is_file():
            raise StudioError(
                "camera_file.missing",
                "camera file not found",
                file=folder / name,
                fix=f"EasyMocap cameras need both {INTRINSICS} and {EXTRINSICS} in one folder.",
            )
    intrinsics, pose = Storage(folder / INTRINSICS), Storage(folder / EXTRINSICS)
    cameras = [_camera(folder, name, intrinsics, pose) for name in intrinsics.names()]
    with naming(folder / INTRINSICS):
        return Rig(tuple(cameras))


def _camera(folder: Path, name: str, intrinsics: Storage, pose: Storage) -> Camera:
    import cv2

    K = intrinsics.needed(f"K_{name}", name, ((3, 3),)).copy()
    K[:2, 2] += 0.5
    distortion = intrinsics.matrix(f"dist_{name}", name)
    vector = pose.matrix(f"R_{name}", name, ((3, 1), (1, 3), (3, 3)))
    rotation = pose.matrix(f"Rot_{name}", name, ((3, 3),))
    if vector is not None:  # preferred, as in EasyMocap: it has more digits than the matrix
        rotation = cv2.Rodrigues(vector)[0] if vector.size == 3 else vector
    if rotation is None:
        with naming(pose.path):
            raise missing_key(f"R_{name}", name)
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = pose.needed(f"T_{name}", name, ((3, 1), (1, 3))).ravel()
    width, height = intrinsics.whole(f"W_{name}", name), intrinsics.whole(f"H_{name}", name)
    with naming(intrinsics.path):
        if width is None or height is None or width < 1 or height < 1:
            width, height = size_nearby(folder, name, name)
        coefficients = distortion.ravel() if distortion is not None and distortion.any() else np.zeros(0)
        return Camera(name, width, height, K, transform, coefficients)


def write_easymocap(rig: Rig, folder: Path) -> None:
    """Write intri.yml and extri.yml.

    Raises:
        StudioError: the folder cannot be written (camera_file.unwritable).
    """
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
        """Append a matrix."""
        data = ", ".join(repr(float(number)) for number in value.ravel())
        rows, columns = value.shape
        self.lines += [f"{key}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
        self.lines += [f"   data: [ {data} ]"]

    def bytes(self) -> bytes:
        """The content of the file."""
        return ("\n".join(self.lines) + "\n").encode()
