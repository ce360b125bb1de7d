"""Measures how well a rig covers a performer: which directions have a camera nearby, and which surfaces are seen."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from v3studio.studio.cameras import Camera
from v3studio.studio.json_types import JsonObject

LEAST_ANGLE, MOST_ANGLE = 35.0, 50.0
"""Degrees to the nearest camera up to which a view is good: three quarters of the typical distance between neighboring
cameras, within these bounds."""

FADE = 20.0  # degrees beyond it in which players fade the image

LARGEST_GAPS = 0.1
"""Share of the way around the performer without a camera nearby, from which on few cameras are warned of; 0 to 1."""

_FACING = math.cos(math.radians(75))
_MOST_DIRECTIONS = 256


@dataclass(frozen=True, eq=False)
class ViewRange:
    """The directions from which a stream looks good: (3,) middle of the scene, world units; (N, 3) unit vectors, N >=
    1, from there to the training cameras; degrees to the nearest of them up to which views are good, above 0, at most
    180."""

    center: np.ndarray
    directions: np.ndarray
    angle: float

    def angle_from(self, eye: Sequence[float] | np.ndarray) -> float:
        """Degrees between the direction to `eye` (3,) and the nearest one; 0 in the center."""
        towards = np.asarray(eye, np.float64) - self.center
        return float(self.angles(towards[None])[0])

    def angles(self, towards: np.ndarray) -> np.ndarray:
        """(M,) degrees between each direction (M, 3), of any length, and the nearest of `directions`."""
        length = np.linalg.norm(towards, axis=1, keepdims=True)
        unit = np.divide(towards, length, out=np.zeros_like(towards), where=length > 0)
        nearest = np.clip((unit @ self.directions.T).max(1), -1, 1)
        return np.where(length[:, 0] > 0, np.degrees(np.arccos(nearest)), 0.0)

    def visibility(self, eye: Sequence[float] | np.ndarray) -> float:
        """The share of the image that players show from `eye` (3,): 1 within the range, 0 from `FADE` degrees
        beyond."""
        return float(np.clip(1 - (self.angle_from(eye) - self.angle) / FADE, 0, 1))

    def to_json(self) -> JsonObject:
        """Return JSON values for the stream's metadata, as docs/STREAM.md describes them."""
        return {
            "center": [round(float(value), 6) for value in self.center],
            "directions": [[round(float(value), 4) for value in direction] for direction in self.directions],
            "angle": round(self.angle, 2),
        }

    @classmethod
    def from_json(cls, values: Any) -> ViewRange | None:
        """Read `to_json`; None if it is malformed."""
        try:
            center = np.array(values["center"], np.float64)
            directions = np.array(values["directions"], np.float64)
            angle = float(values["angle"])
        except (TypeError, ValueError, KeyError, OverflowError):
            return None
        if center.shape != (3,) or directions.ndim != 2 or directions.shape[1] != 3:
            return None
        if not 1 <= len(directions) <= _MOST_DIRECTIONS or not 0 < angle <= 180:
            return None
        length = np.linalg.norm(directions, axis=1, keepdims=True)
        if not (np.isfinite(center).all() and np.isfinite(length).all() and (length > 0.5).all()):
            return None
        return cls(center, directions / length, angle)


def view_range(cameras: Iterable[Camera], center: Sequence[float] | np.ndarray) -> ViewRange | None:
    """The range of views of training cameras around the (3,) middle of a scene, world units; None without cameras
    outside of it. Of more than 256 cameras, every n-th counts."""
    middle = np.asarray(center, np.float64)
    towards = np.array([camera.center - middle for camera in cameras]).reshape(-1, 3)
    length = np.linalg.norm(towards, axis=1, keepdims=True)
    directions = (towards / np.maximum(length, 1e-12))[length[:, 0] > 1e-9]
    directions = directions[:: max(1, -(-len(directions) // _MOST_DIRECTIONS))]
    if not len(directions):
        return None
    spacing = LEAST_ANGLE
    if len(directions) > 1:
        cosines = directions @ directions.T
        np.fill_diagonal(cosines, -1)
        spacing = float(np.median(np.degrees(np.arccos(np.clip(cosines.max(1), -1, 1)))))
    return ViewRange(middle, directions, min(MOST_ANGLE, max(LEAST_ANGLE, 0.75 * spacing)))


@dataclass(frozen=True)
class Coverage:
    """The directions and surfaces that a rig does not see."""

    outside: float  # share of the horizontal directions around the performer that are outside of the view range, 0 to 1
    farthest: float  # largest angle between such a direction and the nearest camera, degrees
    unseen: float  # share of the surface that faces fewer than two cameras, 0 to 1. What hides it is not considered
    angle: float  # of the view range, degrees


def coverage(cameras: Sequence[Camera], points: np.ndarray, normals: np.ndarray, up: np.ndarray) -> Coverage | None:
    """Measure a rig by (N, 3) samples of the surface, N >= 1, world units, and their normals, of any length, outward;
    None without cameras outside of the performer. `up`: (3,)."""
    viewed = view_range(cameras, points.mean(0))
    if viewed is None:
        return None
    outside, farthest = gaps(viewed, up)
    return Coverage(outside, farthest, float((facing_cameras(cameras, points, normals) < 2).mean()), viewed.angle)


def gaps(found: ViewRange, up: np.ndarray) -> tuple[float, float]:
    """The share of the way around the performer that is outside of a range of views, at the height of the cameras,
    which need not be that of the performer's middle: share of horizontal directions, 0 to 1, and the largest angle
    between a direction and the nearest camera, degrees."""
    upright = up / np.linalg.norm(up)
    side = np.cross(upright, np.eye(3)[np.abs(upright).argmin()])
    side /= np.linalg.norm(side)
    turn = np.radians(np.arange(0, 360, 5))[:, None]
    height = float(np.median(found.directions @ upright))
    around = height * upright + math.sqrt(max(0.0, 1 - height**2)) * (
        np.cos(turn) * side + np.sin(turn) * np.cross(upright, side)
    )
    angles = found.angles(around)
    return float((angles > found.angle).mean()), float(angles.max())


def facing_cameras(cameras: Iterable[Camera], points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(N,) number of cameras that have each point in the image and see its surface at less than 75 degrees."""
    unit = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    count = np.zeros(len(points), np.int64)
    for camera in cameras:
        towards = camera.center - points
        towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
        view = camera.undistorted()
        pixels, depth = view.project(points)
        inside = (depth > 0) & (pixels >= 0).all(1) & (pixels < [view.width, view.height]).all(1)
        count += inside & ((unit * towards).sum(1) > _FACING)
    return count
