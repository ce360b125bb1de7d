"""Camera and Rig: intrinsics and poses of a capture.

Conventions, everywhere in V3 Studio:
- OpenCV axes: x right, y down, z forward. `world_to_camera` maps homogeneous world points to camera points.
- Pixels: the origin is the outer corner of the top-left pixel, so pixel (row i, column j) has its center at
  (j + 0.5, i + 0.5). That is the convention of COLMAP, 3DGS and gsplat. OpenCV's own functions put the origin at
  the *center* of the top-left pixel: subtract 0.5 from `cx`, `cy` before handing K to cv2 and add it on the way back
  (`Camera.cv2_K`). Readers and writers of files convert.
- World units are whatever the calibration gives (meters where it knows them).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from studio.errors import StudioError
from studio.rays import nearest_point_to_rays
from studio.validation import array, whole

_DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)


@dataclass(frozen=True, eq=False)
class Camera:
    """One view: pinhole intrinsics, OpenCV lens distortion and a pose.

    Attributes:
        name: unique within its rig.
        width, height: image size in pixels.
        K: (3, 3) float64, pixels, origin at the outer corner of the top-left pixel.
        world_to_camera: (4, 4) float64 rigid transform, OpenCV axes.
        distortion: OpenCV coefficients (k1 k2 p1 p2 [k3 [k4 k5 k6 ...]]); empty means a perfect pinhole.

    Raises:
        StudioError: a value is not finite, the focal length is not positive, the pose is not rigid.
    """

    name: str
    width: int
    height: int
    K: np.ndarray
    world_to_camera: np.ndarray
    distortion: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        K = np.asarray(self.K, dtype=np.float64)
        pose = np.asarray(self.world_to_camera, dtype=np.float64)
        distortion = np.asarray(self.distortion, dtype=np.float64).reshape(-1)
        if pose.shape == (3, 4):
            pose = np.vstack([pose, [0.0, 0.0, 0.0, 1.0]])
        if K.shape != (3, 3) or pose.shape != (4, 4):
            raise StudioError(
                f"Camera '{self.name}': K must be 3x3 and world_to_camera 4x4, found {K.shape} and {pose.shape}."
            )
        for what, value in (("K", K), ("world_to_camera", pose), ("distortion", distortion)):
            broken = np.argwhere(~np.isfinite(value))
            if len(broken):
                place = "".join(f"[{index}]" for index in broken[0])
                raise StudioError(
                    f"Camera '{self.name}': {what}{place} is {value[tuple(broken[0])]}, which is not a finite number; "
                    "mend the calibration file."
                )
        if self.width < 1 or self.height < 1:
            raise StudioError(f"Camera '{self.name}': image size {self.width}x{self.height} must be at least 1x1.")
        if K[0, 0] <= 0 or K[1, 1] <= 0:
            raise StudioError(
                f"Camera '{self.name}': focal lengths must be positive, found {K[0, 0]:g} and {K[1, 1]:g}."
            )
        rotation = pose[:3, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
            raise StudioError(f"Camera '{self.name}': the rotation in world_to_camera is not orthonormal.")
        if distortion.size not in _DISTORTION_LENGTHS:
            raise StudioError(
                f"Camera '{self.name}': {distortion.size} distortion coefficients given; "
                f"OpenCV's model takes one of {_DISTORTION_LENGTHS}."
            )
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "world_to_camera", pose)
        object.__setattr__(self, "distortion", distortion)
        object.__setattr__(self, "width", int(self.width))
        object.__setattr__(self, "height", int(self.height))

    @property
    def fx(self) -> float:
        """Horizontal focal length in pixels."""
        return float(self.K[0, 0])

    @property
    def fy(self) -> float:
        """Vertical focal length in pixels."""
        return float(self.K[1, 1])

    @property
    def cx(self) -> float:
        """Principal point, pixels from the left image border."""
        return float(self.K[0, 2])

    @property
    def cy(self) -> float:
        """Principal point, pixels from the upper image border."""
        return float(self.K[1, 2])

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3): world to camera."""
        return self.world_to_camera[:3, :3]

    @property
    def translation(self) -> np.ndarray:
        """(3,): world to camera."""
        return self.world_to_camera[:3, 3]

    @property
    def center(self) -> np.ndarray:
        """(3,): the optical center in world coordinates."""
        return -self.rotation.T @ self.translation

    @property
    def forward(self) -> np.ndarray:
        """(3,): unit viewing direction in world coordinates."""
        return self.rotation[2]

    @property
    def is_pinhole(self) -> bool:
        """True where no lens distortion is left."""
        return not np.any(self.distortion)

    @property
    def cv2_K(self) -> np.ndarray:
        """(3, 3): K in OpenCV's pixel convention (origin at the center of the top-left pixel)."""
        K = self.K.copy()
        K[:2, 2] -= 0.5
        return K

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project world points, with lens distortion where there is any.

        Args:
            points: (N, 3) world coordinates.

        Returns:
            pixels (N, 2), origin at the image corner, and depths (N,) along the viewing axis. Points with depth <= 0
            lie behind the camera and their pixels mean nothing.
        """
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        local = points @ self.rotation.T + self.translation
        depth = local[:, 2]
        safe = np.where(np.abs(depth) < 1e-12, 1e-12, depth)
        if self.is_pinhole:
            xy = local[:, :2] / safe[:, None]
            pixels = xy @ self.K[:2, :2].T + self.K[:2, 2]
        else:
            import cv2

            normalized = np.column_stack([local[:, :2] / safe[:, None], np.ones(len(local))])
            pixels, _ = cv2.projectPoints(normalized, np.zeros(3), np.zeros(3), self.K, self.distortion)
            pixels = pixels.reshape(-1, 2)
        return pixels, depth

    def normalized(self, pixels: np.ndarray) -> np.ndarray:
        """Normalized image coordinates x / z, y / z in camera axes, without lens distortion.

        Args:
            pixels: (N, 2), origin at the image corner; rows with NaN give NaN.

        Returns:
            (N, 2) float64. Lens distortion is inverted by iteration; far outside the image it may not converge.
        """
        pixels = np.asarray(pixels, np.float64).reshape(-1, 2)
        if self.is_pinhole:
            result: np.ndarray = np.linalg.solve(self.K, np.column_stack([pixels, np.ones(len(pixels))]).T)[:2].T
            return result
        import cv2

        found = np.full_like(pixels, np.nan)
        known = np.isfinite(pixels).all(axis=1)
        if known.any():
            until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
            points = cv2.undistortPoints(pixels[known][:, None], self.K, self.distortion, criteria=until)
            found[known] = points.reshape(-1, 2)
        return found

    def unproject(self, pixels: np.ndarray, depth: float | np.ndarray = 1.0) -> np.ndarray:
        """World points that `project` to the given pixels and depths.

        Args:
            pixels: (N, 2), origin at the image corner.
            depth: distance along the viewing axis, one value or (N,).

        Returns:
            (N, 3) world coordinates, NaN where the pixel is.
        """
        xy = self.normalized(pixels)
        local = np.column_stack([xy, np.ones(len(xy))]) * np.broadcast_to(depth, len(xy))[:, None]
        world: np.ndarray = (local - self.translation) @ self.rotation
        return world

    def ray_directions(self, pixels: np.ndarray) -> np.ndarray:
        """(N, 3) unit directions in world coordinates from `center` through pixels (N, 2)."""
        xy = self.normalized(pixels)
        rays = np.column_stack([xy, np.ones(len(xy))]) @ self.rotation
        result: np.ndarray = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return result

    def undistorted(self) -> Camera:
        """The pinhole camera that undistorted images belong to: same K, pose and size, no distortion."""
        return replace(self, distortion=np.zeros(0))

    def resized(self, width: int, height: int) -> Camera:
        """The same view at another image size; K follows each axis exactly."""
        scale = np.diag([width / self.width, height / self.height, 1.0])
        return replace(self, width=width, height=height, K=scale @ self.K)

    def scaled(self, factor: float) -> Camera:
        """The same view at `factor` times the size, rounded to whole pixels (at least 1x1)."""
        return self.resized(max(1, round(self.width * factor)), max(1, round(self.height * factor)))

    def cropped(self, left: int, top: int, width: int, height: int) -> Camera:
        """The part of the image that starts at column `left`, row `top`; pinhole cameras only render there."""
        K = self.K.copy()
        K[0, 2] -= left
        K[1, 2] -= top
        return replace(self, width=width, height=height, K=K)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready form, read back by `from_dict` (pixel origin at the image corner)."""
        return {
            "name": self.name,
            "width": self.width,
            "height": self.height,
            "K": self.K.tolist(),
            "world_to_camera": self.world_to_camera.tolist(),
            "distortion": self.distortion.tolist(),
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Camera:
        """Inverse of `to_dict`.

        Raises:
            StudioError: a key is missing or a value is not usable.
        """
        who = f"Camera '{values.get('name', '?')}'"
        for key in ("name", "K", "world_to_camera"):
            if key not in values:
                raise StudioError(f"{who}: the key '{key}' is missing.")
        return cls(
            name=str(values["name"]),
            width=whole(values, "width", who),
            height=whole(values, "height", who),
            K=array(values["K"], "K", who),
            world_to_camera=array(values["world_to_camera"], "world_to_camera", who),
            distortion=array(values.get("distortion", []), "distortion", who),
        )


@dataclass(frozen=True, eq=False)
class Rig:
    """The cameras of a capture, in a fixed order, with unique names."""

    cameras: tuple[Camera, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        seen: set[str] = set()
        for camera in self.cameras:
            if camera.name in seen:
                raise StudioError(f"Two cameras are named '{camera.name}'; give each camera a name of its own.")
            seen.add(camera.name)

    def __len__(self) -> int:
        return len(self.cameras)

    def __iter__(self) -> Iterator[Camera]:
        return iter(self.cameras)

    def __contains__(self, name: str) -> bool:
        return name in self.names

    def __getitem__(self, name: str) -> Camera:
        for camera in self.cameras:
            if camera.name == name:
                return camera
        raise StudioError(f"There is no camera '{name}'; the rig has {', '.join(self.names)}.")

    @property
    def names(self) -> tuple[str, ...]:
        """Camera names in rig order."""
        return tuple(camera.name for camera in self.cameras)

    @property
    def centers(self) -> np.ndarray:
        """(C, 3): optical centers in world coordinates."""
        return np.array([camera.center for camera in self.cameras]).reshape(-1, 3)

    @property
    def up(self) -> np.ndarray:
        """(3,): unit mean of the cameras' up directions (minus their y axes)."""
        mean = -np.mean([camera.rotation[1] for camera in self.cameras], axis=0)
        return mean / max(np.linalg.norm(mean), 1e-12)

    @property
    def focus(self) -> np.ndarray:
        """(3,): the point nearest, in least squares, to all viewing axes."""
        directions = np.array([camera.forward for camera in self.cameras])
        return nearest_point_to_rays(self.centers, directions)

    def subset(self, names: Sequence[str]) -> Rig:
        """The named cameras only, in the given order."""
        return Rig(tuple(self[name] for name in names))


def look_at_pose(eye: np.ndarray, target: np.ndarray, up: np.ndarray) -> np.ndarray:
    """World-to-camera matrix (4, 4) float64 of an upright camera at `eye` whose viewing axis goes through `target`.

    Args:
        eye, target: (3,) world coordinates, not equal.
        up: (3,) direction of any length that is not parallel to the viewing axis; it appears upwards in the image.
    """
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = -rotation @ eye
    return pose
