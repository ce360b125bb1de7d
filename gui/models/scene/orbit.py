"""OrbitCamera: the free view, moved by drags and the wheel.

It orbits a target with a fixed up direction and never rolls; `camera()` returns the pinhole camera to render with
(OpenCV axes, see `studio.cameras`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from v3studio.studio.cameras import Camera

_WIDEST = math.radians(75.0)  # field of view of a first view
_STEEPEST = math.radians(10.0)  # of a first view, above or below the horizon
_MAX_PITCH = math.radians(89.0)
_TURN = math.radians(0.4)  # per pixel dragged
FILLED = 0.92  # share of an image that is filled by what it must show, see `OrbitCamera.filling`

_ZOOM_STEP = 0.9  # distance factor of one notch of the wheel


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)


@dataclass
class OrbitCamera:
    """An orbit view."""

    target: np.ndarray = field(default_factory=lambda: np.zeros(3))  # (3,) world point that it looks at and orbits
    up: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # (3,) world up direction
    distance: float = 3.0  # distance from the target in world units, above 0
    yaw: float = 0.0  # radians about `up`, from an arbitrary fixed direction
    pitch: float = 0.0  # radians above the horizon, within 89 degrees
    fov: float = math.radians(45.0)  # vertical field of view, radians

    def __post_init__(self) -> None:
        self.target = np.asarray(self.target, dtype=np.float64)
        self.up = _unit(np.asarray(self.up, dtype=np.float64))

    @classmethod
    def around(cls, points: np.ndarray, up: np.ndarray) -> OrbitCamera:
        """A view that contains almost all of the (N, 3) points, world coordinates; a few outliers do not affect it.
        Without points, a unit ball at the origin is framed."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        if len(points) == 0:
            points = np.eye(3)
        middle = np.median(points, axis=0)
        low, high = np.percentile(points, [1.0, 99.0], axis=0)
        target = np.where(np.isfinite(low + high), 0.5 * (low + high), middle)
        radius = max(float(np.percentile(np.linalg.norm(points - target, axis=1), 98.0)), 1e-6)
        return cls(target=target, up=up, distance=1.15 * radius / math.sin(0.5 * cls.fov))

    @classmethod
    def looking_through(cls, camera: Camera, target: np.ndarray, up: np.ndarray) -> OrbitCamera:
        """A capture camera's view without roll, orbiting the point on its axis that is nearest to the target."""
        along = float(np.dot(np.asarray(target) - camera.center, camera.forward))
        distance = along if along > 1e-6 else max(float(np.linalg.norm(np.asarray(target) - camera.center)), 1e-6)
        orbit = cls(
            target=camera.center + distance * camera.forward,
            up=up,
            distance=distance,
            fov=2.0 * math.atan(0.5 * camera.height / camera.fy),
        )
        return orbit._facing(camera.forward)

    @classmethod
    def showing(cls, points: np.ndarray, up: np.ndarray, camera: Camera | None) -> OrbitCamera:
        """The first view: from a camera's place, if not too near, at eye level, with everybody, as in the player."""
        orbit = cls.around(points, up)
        if camera is None:
            return orbit
        away = camera.center - orbit.target
        apart = max(float(np.linalg.norm(away)), 1e-9)
        radius = orbit.distance * math.sin(0.5 * orbit.fov)
        half = min(math.asin(min(radius / apart, 1.0)), 0.5 * _WIDEST)
        moved = cls.from_to(orbit.target + away * (radius / math.sin(half) / apart), orbit.target, up, 2.0 * half)
        return replace(moved, pitch=float(np.clip(moved.pitch, -_STEEPEST, _STEEPEST)))

    @classmethod
    def from_to(cls, eye: np.ndarray, target: np.ndarray, up: np.ndarray, fov: float) -> OrbitCamera:
        """The view from a point to another one, which it orbits. `fov`: vertical field of view, radians."""
        orbit = cls(target=target, up=up, distance=float(np.linalg.norm(target - eye)), fov=fov)
        return orbit._facing(target - eye)

    def basis(self) -> tuple[np.ndarray, np.ndarray]:
        """Two fixed directions that span the plane perpendicular to `up`; the first is yaw 0."""
        helper = np.eye(3)[int(np.argmin(np.abs(self.up)))]
        first = _unit(helper - np.dot(helper, self.up) * self.up)
        return first, np.cross(self.up, first)

    def _facing(self, forward: np.ndarray) -> OrbitCamera:
        first, second = self.basis()
        back = -_unit(forward)
        pitch = math.asin(float(np.clip(np.dot(back, self.up), -1.0, 1.0)))
        yaw = math.atan2(float(np.dot(back, second)), float(np.dot(back, first)))
        return replace(self, yaw=yaw, pitch=float(np.clip(pitch, -_MAX_PITCH, _MAX_PITCH)))

    @property
    def key(self) -> tuple[float, ...]:
        """The view as numbers: equal keys mean equal views."""
        return (*self.target.tolist(), *self.up.tolist(), self.distance, self.yaw, self.pitch, self.fov)

    @property
    def offset(self) -> np.ndarray:
        """(3,): unit direction from the target to the eye."""
        first, second = self.basis()
        flat = math.cos(self.yaw) * first + math.sin(self.yaw) * second
        return math.cos(self.pitch) * flat + math.sin(self.pitch) * self.up

    @property
    def eye(self) -> np.ndarray:
        """(3,): position of the viewer in world coordinates."""
        return self.target + self.distance * self.offset

    def _axes(self) -> np.ndarray:
        """(3, 3): rows are the camera's x, y, z axes in world coordinates."""
        z = -self.offset
        x = _unit(np.cross(z, self.up))
        return np.stack([x, np.cross(z, x), z])

    def orbit(self, dx: float, dy: float) -> OrbitCamera:
        """This view orbited by a drag of (dx, dy) pixels: the scene follows the pointer."""
        pitch = float(np.clip(self.pitch + _TURN * dy, -_MAX_PITCH, _MAX_PITCH))
        return replace(self, yaw=(self.yaw - _TURN * dx) % math.tau, pitch=pitch)

    def pan(self, dx: float, dy: float, height: int) -> OrbitCamera:
        """This view after a pan by (dx, dy) pixels in an image `height` high: the target stays under the pointer."""
        per_pixel = 2.0 * self.distance * math.tan(0.5 * self.fov) / max(height, 1)
        x, y, _ = self._axes()
        return replace(self, target=self.target - per_pixel * (dx * x + dy * y))

    def zoom(self, notches: float) -> OrbitCamera:
        """This view moved closer (positive) or farther away by notches of the wheel."""
        return replace(self, distance=float(np.clip(self.distance * _ZOOM_STEP**notches, 1e-4, 1e6)))

    def widened(self, points: np.ndarray, width: int, height: int) -> float:
        """Factor, at most 1, by which an image must be reduced to contain all points (N, 3) from left to right."""
        if len(points) == 0:
            return 1.0
        camera = self.camera(width, height)
        pixels, depth = camera.project(points)
        across = np.abs(pixels[depth > 1e-6, 0] - 0.5 * width)
        return min(1.0, 0.5 * 0.85 * width / max(float(across.max(initial=0.0)), 1e-6))

    def filling(self, points: np.ndarray, width: int, height: int) -> Camera:
        """The pinhole camera that looks in this direction, its image filled by the points (N, 3) but for a margin."""
        camera = self.camera(width, height)
        if len(points) == 0:
            return camera
        pixels, depth = camera.project(points)
        pixels = pixels[depth > 1e-6]
        if not len(pixels):
            return camera
        low, high = np.quantile(pixels, (0.002, 0.998), axis=0)  # a stray splat does not count
        size = np.array([width, height], np.float64)
        factor = FILLED * float((size / np.maximum(high - low, 1e-6)).min())
        K = camera.K.copy()
        K[:2, :2] *= factor
        K[:2, 2] = 0.5 * size - factor * (0.5 * (low + high) - K[:2, 2])
        return Camera("viewer", width, height, K, camera.world_to_camera)

    def camera(self, width: int, height: int, reduced: float = 1.0) -> Camera:
        """The pinhole camera to render with: square pixels, centered; `reduced` below 1 shows more around it."""
        focal = 0.5 * height / math.tan(0.5 * self.fov) * reduced
        K = np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])
        pose = np.eye(4)
        pose[:3, :3] = self._axes()
        pose[:3, 3] = -pose[:3, :3] @ self.eye
        return Camera("viewer", width, height, K, pose)
