"""CamPose.inf and Intrinsic.inf of ReRF (and NHR).

CamPose.inf has one line of 12 numbers per camera: its z, x and y axes and its center in the world (OpenCV axes).
Intrinsic.inf has, per camera, one line with its number and three lines with K. Cameras are numbered from 0; videos are
named 000.mp4 and images img_0000.png. There is no lens distortion. The pixel origin of K is the center of the first
pixel, as in OpenCV.
"""

from pathlib import Path

import numpy as np

from v3studio.studio.camera_files.common import need_both, read_text, rigid_inverse
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import NO_DISTORTION
from v3studio.studio.camera_files.common.nearby import size_nearby
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.validation import array, check_finite

_POSES, _INTRINSICS = "CamPose.inf", "Intrinsic.inf"


def read(file: CameraFile) -> Rig:
    """Read both files of a folder; image sizes come from the footage in image/."""
    folder = file.path.parent
    need_both(folder, (_POSES, _INTRINSICS), "ReRF")
    with naming(folder / _POSES):
        poses = _poses(folder / _POSES)
    with naming(folder / _INTRINSICS):
        intrinsics = _intrinsics(folder / _INTRINSICS)
        if len(poses) != len(intrinsics):
            problem = f"the file contains {counted(len(intrinsics), 'camera')}, but {_POSES} contains {len(poses)}"
            fix = "Copy both files again."
            raise StudioError("camera_file.camera_count", problem, value=len(intrinsics), fix=fix, expected=len(poses))
    cameras = []
    with naming(folder / _POSES):
        for index, (pose, K) in enumerate(zip(poses, intrinsics, strict=True)):
            name, size = _footage(folder, index)
            cameras.append(Camera(name, *size, K, rigid_inverse(pose)))
    return Rig(tuple(cameras), (NO_DISTORTION,))


def _rows(path: Path) -> list[tuple[int, list[float]]]:
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        row = array(line.split(), f"line {number}", "?").tolist()
        if row:
            rows.append((number, row))
    return rows


def _poses(path: Path) -> list[np.ndarray]:
    poses: list[np.ndarray] = []
    for number, row in _rows(path):
        if len(row) != 12:
            raise _truncated(number, len(row), 12)
        check_finite(np.array(row), f"line {number}", str(len(poses)))
        z, x, y, center = np.array(row).reshape(4, 3)
        poses.append(np.column_stack([x, y, z, center]))
    return poses


def _truncated(line: int, count: int, expected: int) -> StudioError:
    problem = f"found {count} numbers for the camera at line {line}, expected {expected}"
    fix = "The file may be truncated: copy it again."
    return StudioError("camera_file.truncated", problem, value=count, fix=fix, line=line, expected=expected)


def _intrinsics(path: Path) -> list[np.ndarray]:
    rows = [(number, row) for number, row in _rows(path) if len(row) != 1]
    matrices: list[np.ndarray] = []
    for start in range(0, len(rows), 3):
        part = rows[start : start + 3]
        if len(part) < 3 or any(len(row) != 3 for _, row in part):
            raise _truncated(part[0][0], sum(len(row) for _, row in part), 9)
        K = np.array([row for _, row in part])
        check_finite(K, "K", str(len(matrices)))
        K[:2, 2] += 0.5
        matrices.append(K)
    return matrices


def _footage(folder: Path, index: int) -> tuple[str, tuple[int, int]]:
    """Name and image size of a camera, from its footage."""
    for images in ("image", "img"):
        numbered = (part for part in (folder / images).glob("[0-9]*") if part.is_dir() and part.name.isdecimal())
        frames = sorted(numbered, key=lambda part: int(part.name))
        if frames:
            return f"{index:04d}", size_nearby(frames[0], f"img_{index:04d}", str(index))
    return f"{index:03d}", size_nearby(folder, f"{index:03d}", str(index))
