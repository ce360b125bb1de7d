"""intri.yml and extri.yml as EasyMocap writes them with OpenCV's FileStorage.

`names` lists the cameras; `K_<name>` (3 x 3), `dist_<name>` (OpenCV's order) stand in intri.yml, `R_<name>` (rotation
vector), `Rot_<name>` (matrix) and `T_<name>` in extri.yml: x ~ K (R X + T) with OpenCV's axes. The pixel origin is
OpenCV's, the center of the first pixel. `H_<name>`, `W_<name>` are newer; older files have no image size.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np

from studio.camera_files.common import naming, read_text, write_atomic
from studio.camera_files.nearby import size_nearby
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.validation import check_finite, whole

INTRINSICS, EXTRINSICS = "intri.yml", "extri.yml"


class _File:
    """One of the two files: OpenCV reads it, we check what it says."""

    def __init__(self, path: Path) -> None:
        import cv2

        self.path = path
        text = read_text(path)
        try:
            self.storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        except (cv2.error, SystemError) as error:  # OpenCV 5's binding turns some of its errors into SystemError
            reason = str(error.__cause__ or error).split("error:")[-1].strip().splitlines()[0]
            raise StudioError(
                f"{path}: OpenCV cannot read it ({reason}); the file may be cut short, export the cameras again."
            ) from None

    def names(self) -> list[str]:
        """The cameras."""
        node = self.storage.getNode("names")
        if node.empty() or not node.size():
            raise StudioError(f"{self.path}: the list 'names' is missing or empty; export the cameras again.")
        entries = [node.at(index) for index in range(node.size())]
        return [entry.string() if entry.isString() else str(int(entry.real())) for entry in entries]

    def matrix(self, key: str, who: str, shapes: tuple[tuple[int, int], ...] = ()) -> np.ndarray | None:
        """A matrix, or None where there is none of that name."""
        import cv2

        node = self.storage.getNode(key)
        if node.empty():
            return None
        value: Any = None
        if node.isMap():
            with contextlib.suppress(cv2.error):
                value = node.mat()
        if value is None:
            raise StudioError(f"{self.path}: {who}: '{key}' is not a whole matrix.")
        matrix = np.asarray(value, np.float64)
        if shapes and matrix.shape not in shapes:
            raise StudioError(
                f"{self.path}: {who}: '{key}' is {matrix.shape[0]}x{matrix.shape[1]}; "
                f"{' or '.join(f'{r}x{c}' for r, c in shapes)} is needed."
            )
        with naming(self.path):
            check_finite(matrix, key, who)
        return matrix

    def needed(self, key: str, who: str, shapes: tuple[tuple[int, int], ...] = ()) -> np.ndarray:
        """A matrix that must be there."""
        matrix = self.matrix(key, who, shapes)
        if matrix is None:
            raise StudioError(f"{self.path}: {who}: the key '{key}' is missing.")
        return matrix

    def whole(self, key: str, who: str) -> int | None:
        """A whole number, or None."""
        node = self.storage.getNode(key)
        if node.empty():
            return None
        value = node.real() if node.isInt() or node.isReal() else node.string() if node.isString() else None
        with naming(self.path):
            return whole({key: value}, key, who)


def read_easymocap(folder: Path) -> Rig:
    """Read both files of a folder.

    Raises:
        StudioError: a file or a key is missing, a value is unusable, the images' size is nowhere.
    """
    for name in (INTRINSICS, EXTRINSICS):
        if not (folder / name).is_file():
            raise StudioError(f"{folder / name}: is missing; EasyMocap's cameras are the two files side by side.")
    lens, pose = _File(folder / INTRINSICS), _File(folder / EXTRINSICS)
    cameras = [_camera(folder, name, lens, pose) for name in lens.names()]
    with naming(folder / INTRINSICS):
        return Rig(tuple(cameras))


def _camera(folder: Path, name: str, lens: _File, pose: _File) -> Camera:
    import cv2

    who = f"Camera '{name}'"
    K = lens.needed(f"K_{name}", who, ((3, 3),)).copy()
    K[:2, 2] += 0.5
    distortion = lens.matrix(f"dist_{name}", who)
    vector = pose.matrix(f"R_{name}", who, ((3, 1), (1, 3), (3, 3)))
    rotation = pose.matrix(f"Rot_{name}", who, ((3, 3),))
    if vector is not None:  # as EasyMocap itself: written with more digits than the matrix
        rotation = cv2.Rodrigues(vector)[0] if vector.size == 3 else vector
    if rotation is None:
        raise StudioError(f"{pose.path}: {who}: neither 'R_{name}' nor 'Rot_{name}' is there.")
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = pose.needed(f"T_{name}", who, ((3, 1), (1, 3))).ravel()
    width, height = lens.whole(f"W_{name}", who), lens.whole(f"H_{name}", who)
    with naming(lens.path):
        if width is None or height is None or width < 1 or height < 1:
            width, height = size_nearby(folder, name, who)
        coefficients = distortion.ravel() if distortion is not None and distortion.any() else np.zeros(0)
        return Camera(name, width, height, K, transform, coefficients)


def write_easymocap(rig: Rig, folder: Path) -> None:
    """Write intri.yml and extri.yml.

    Raises:
        StudioError: a camera with skew is no trouble, but a folder that cannot be written is.
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
    """What OpenCV's FileStorage would write, with all digits."""

    def __init__(self, names: list[str]) -> None:
        self.lines = ["%YAML:1.0", "---", "names:", *(f'   - "{name}"' for name in names)]

    def matrix(self, key: str, value: np.ndarray) -> None:
        """Add one."""
        data = ", ".join(repr(float(number)) for number in value.ravel())
        rows, columns = value.shape
        self.lines += [f"{key}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
        self.lines += [f"   data: [ {data} ]"]

    def bytes(self) -> bytes:
        """The file."""
        return ("\n".join(self.lines) + "\n").encode()
