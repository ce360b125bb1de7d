"""CamPose.inf and Intrinsic.inf of ReRF (and NHR).

CamPose.inf has a line a camera of 12 numbers: the camera's z, x and y axis and its center in the world (OpenCV's axes).
Intrinsic.inf has, a camera each, a line with its number and three lines with K. Cameras are numbered from 0; videos are
named 000.mp4, images img_0000.png. The lenses have no distortion. K counts from the center of the first pixel, as in
OpenCV.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from studio.camera_files.common import naming, read_text, rigid_inverse
from studio.camera_files.nearby import size_nearby
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.validation import array, check_finite

POSES, INTRINSICS = "CamPose.inf", "Intrinsic.inf"


def read_rerf(folder: Path) -> Rig:
    """Read both files of a folder; image sizes come from the footage in image/.

    Raises:
        StudioError: a file is missing or cut short, a value is unusable, there is no footage.
    """
    for name in (POSES, INTRINSICS):
        if not (folder / name).is_file():
            raise StudioError(f"{folder / name}: is missing; ReRF's cameras are {POSES} and {INTRINSICS} side by side.")
    poses, lenses = _poses(folder / POSES), _lenses(folder / INTRINSICS)
    if len(poses) != len(lenses):
        raise StudioError(
            f"{folder / INTRINSICS}: has {len(lenses)} cameras, {POSES} beside it has {len(poses)}; copy both again."
        )
    cameras = []
    for index, (pose, K) in enumerate(zip(poses, lenses, strict=True)):
        who = f"Camera '{index}'"
        with naming(folder / POSES):
            name, size = _footage(folder, index, who)
            cameras.append(Camera(name, *size, K, rigid_inverse(pose)))
    return Rig(tuple(cameras))


def _rows(path: Path) -> list[tuple[int, list[float]]]:
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        with naming(path):
            values = array(line.split(), f"line {number}", "Cameras").tolist()
        if values:
            rows.append((number, values))
    return rows


def _poses(path: Path) -> list[np.ndarray]:
    found: list[np.ndarray] = []
    for number, values in _rows(path):
        if len(values) != 12:
            raise StudioError(f"{path}: line {number} has {len(values)} numbers; 12 are needed. Is it cut short?")
        with naming(path):
            check_finite(np.array(values), f"line {number}", f"Camera '{len(found)}'")
        z, x, y, center = np.array(values).reshape(4, 3)
        pose = np.eye(4)
        pose[:3] = np.column_stack([x, y, z, center])
        found.append(pose)
    return found


def _lenses(path: Path) -> list[np.ndarray]:
    rows = [(number, values) for number, values in _rows(path) if len(values) != 1]
    found: list[np.ndarray] = []
    for start in range(0, len(rows), 3):
        part = rows[start : start + 3]
        if len(part) < 3 or any(len(values) != 3 for _, values in part):
            raise StudioError(f"{path}: K is not three lines of three numbers at line {part[0][0]}; is it cut short?")
        K = np.array([values for _, values in part])
        with naming(path):
            check_finite(K, "K", f"Camera '{len(found)}'")
        K[:2, 2] += 0.5
        found.append(K)
    return found


def _footage(folder: Path, index: int, who: str) -> tuple[str, tuple[int, int]]:
    """Name and image size of a camera, as its footage has them."""
    numbered = (part for part in (folder / "image").glob("[0-9]*") if part.is_dir() and part.name.isdecimal())
    frames = sorted(numbered, key=lambda part: int(part.name))
    if frames:
        return f"{index:04d}", size_nearby(frames[0], f"img_{index:04d}", who)
    return f"{index:03d}", size_nearby(folder, f"{index:03d}", who)
