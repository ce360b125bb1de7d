"""intri.yml and extri.yml of EasyMocap, written with OpenCV's FileStorage.

`names` lists the cameras. intri.yml has `K_<name>` (3 x 3) and `dist_<name>` (OpenCV order); extri.yml has `R_<name>`
(rotation vector), `Rot_<name>` (matrix) and `T_<name>`: x ~ K (R X + T) with OpenCV axes. The pixel origin is OpenCV's,
the center of the first pixel. Newer files also have the image size, `H_<name>` and `W_<name>`.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np

from studio.camera_files.common import naming, no_cameras, read_text, write_atomic, wrong_shape
from studio.camera_files.nearby import size_nearby
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.validation import check_finite, missing_key, whole

INTRINSICS, EXTRINSICS = "intri.yml", "extri.yml"


class _File:
    """One of the two files, parsed by OpenCV and then validated."""

    def __init__(self, path: Path) -> None:
        import cv2

        self.path = path
        text = read_text(path)
        try:
            self.storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        except (cv2.error, SystemError) as error:  # OpenCV 5's bindings raise SystemError for some errors
            reason = str(error.__cause__ or error).split("error:")[-1].strip().splitlines()[0]
            raise StudioError(
                "camera_file.syntax",
                f"OpenCV cannot parse the file ({reason})",
                file=path,
                fix="The file may be truncated: export the cameras again.",
            ) from None

    def names(self) -> list[str]:
        """Names of the cameras."""
        node = self.storage.getNode("names")
        if node.empty() or not node.size():
            raise no_cameras("the list 'names' is missing or empty", self.path)
        entries = [node.at(index) for index in range(node.size())]
        return [entry.string() if entry.isString() else str(int(entry.real())) for entry in entries]

    def matrix(self, key: str, camera: str, shapes: tuple[tuple[int, int], ...] = ()) -> np.ndarray | None:
        """A finite matrix of one of the shapes (any if empty); None if the key is missing."""
        import cv2

        node = self.storage.getNode(key)
        if node.empty():
            return None
        value: Any = None
        if node.isMap():
            with contextlib.suppress(cv2.error):
                value = node.mat()
        if value is None:
            raise StudioError(
                "camera.not_a_matrix",
                f"Camera '{camera}': '{key}' is not a complete matrix",
                file=self.path,
                fix="Export the cameras again.",
                camera=camera,
                key=key,
            )
        matrix = np.asarray(value, np.float64)
        with naming(self.path):
            if shapes and matrix.shape not in shapes:
                raise wrong_shape(key, camera, matrix.shape, shapes)
            check_finite(matrix, key, camera)
        return matrix

    def needed(self, key: str, camera: str, shapes: tuple[tuple[int, int], ...] = ()) -> np.ndarray:
        """A required matrix."""
        matrix = self.matrix(key, camera, shapes)
        if matrix is None:
            with naming(self.path):
                raise missing_key(key, camera)
        return matrix

    def whole(self, key: str, camera: str) -> int | None:
        """An integer, or None if the key is missing."""
        node = self.storage.getNode(key)
        if node.empty():
            return None
        value = node.real() if node.isInt() or node.isReal() else node.string() if node.isString() else None
        with naming(self.path):
            return whole({key: value}, key, camera)


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
    lens, pose = _File(folder / INTRINSICS), _File(folder / EXTRINSICS)
    cameras = [_camera(folder, name, lens, pose) for name in lens.names()]
    with naming(folder / INTRINSICS):
        return Rig(tuple(cameras))


def _camera(folder: Path, name: str, lens: _File, pose: _File) -> Camera:
    import cv2

    K = lens.needed(f"K_{name}", name, ((3, 3),)).copy()
    K[:2, 2] += 0.5
    distortion = lens.matrix(f"dist_{name}", name)
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
    width, height = lens.whole(f"W_{name}", name), lens.whole(f"H_{name}", name)
    with naming(lens.path):
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

    lens = _Text([camera.name for camera in rig])
    pose = _Text([camera.name for camera in rig])
    for camera in rig:
        coefficients = np.zeros(max(5, camera.distortion.size))
        coefficients[: camera.distortion.size] = camera.distortion
        lens.matrix(f"K_{camera.name}", camera.cv2_K)
        lens.matrix(f"dist_{camera.name}", coefficients[None])
        lens.lines += [f"H_{camera.name}: {camera.height}", f"W_{camera.name}: {camera.width}"]
        pose.matrix(f"R_{camera.name}", cv2.Rodrigues(camera.rotation)[0])
        pose.matrix(f"Rot_{camera.name}", camera.rotation)
        pose.matrix(f"T_{camera.name}", camera.translation[:, None])
    write_atomic(folder / INTRINSICS, lens.bytes())
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
