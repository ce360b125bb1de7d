"""Camera and Rig: intrinsics and poses of a capture.

Conventions throughout V3 Studio:
- OpenCV axes: x right, y down, z forward. `world_to_camera` maps homogeneous world points to camera points.
- Pixels: the origin is the outer corner of the top-left pixel, so the center of pixel (row i, column j) is at
  (j + 0.5, i + 0.5), as in COLMAP, 3DGS and gsplat. OpenCV puts the origin at the *center* of the top-left pixel:
  subtract 0.5 from `cx`, `cy` before passing K to cv2, and add it to what cv2 returns (`Camera.cv2_K`). File readers
  and writers convert.
- World units are those of the calibration: meters if its scale is metric.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from v3studio.studio.counts import counted, short_repr
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject
from v3studio.studio.lenses import distorted, fisheye_undistorted
from v3studio.studio.validation import array, camera_error, check_finite, missing_key, whole

OPENGL_AXES = np.diag([1.0, -1.0, -1.0, 1.0])
"""Turns the camera axes of OpenGL and of film tools (y up, looking along -z) into those of OpenCV, and back."""

_DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)
_FISHEYE_LENGTHS = (4, 8)

_WIDEST = np.tan(np.radians(60))
"""How far a fisheye's pinhole view reaches to each side of the axis, x / z: beyond, pixels stand for ever less."""


@dataclass(frozen=True, eq=False, repr=False)
class Camera:
    """Intrinsics, lens and pose of one camera.

    Attributes:
        name: unique within its rig.
        width, height: image size in pixels.
        K: (3, 3) float64, pixels, origin at the outer corner of the top-left pixel.
        world_to_camera: (4, 4) float64 rigid transform, OpenCV axes.
        distortion: OpenCV coefficients (k1 k2 p1 p2 [k3 [k4 k5 k6 ...]]); empty for a pinhole camera; of a fisheye
            k1 k2 k3 k4 as in OpenCV [p1 p2 s1 s2 as in COLMAP].
        fisheye: whether the lens is a fisheye, of which directions less than 90 degrees from the axis are used.

    Raises:
        StudioError: a matrix has the wrong shape (camera.wrong_shape), a value is not finite (camera.not_finite), the
            image size (camera.image_size) or focal length (camera.focal_length) is not positive, K is no matrix of
            intrinsics (camera.intrinsics), the pose is not rigid (camera.rotation), or the number of distortion
            coefficients is wrong (camera.distortion).
    """

    name: str
    width: int
    height: int
    K: np.ndarray
    world_to_camera: np.ndarray
    distortion: np.ndarray = field(default_factory=lambda: np.zeros(0))
    fisheye: bool = False

    def __post_init__(self) -> None:
        K = np.asarray(self.K, dtype=np.float64)
        pose = np.asarray(self.world_to_camera, dtype=np.float64)
        distortion = np.asarray(self.distortion, dtype=np.float64).reshape(-1)
        if self.fisheye and distortion.size == 0:
            distortion = np.zeros(4)
        if pose.shape == (3, 4):
            pose = np.vstack([pose, [0.0, 0.0, 0.0, 1.0]])
        if K.shape != (3, 3) or pose.shape != (4, 4):
            raise camera_error(
                "camera.wrong_shape",
                self.name,
                f"K is {K.shape} and world_to_camera {pose.shape}, expected (3, 3) and (4, 4)",
                value=[list(K.shape), list(pose.shape)],
                fix="",
                expected=[[3, 3], [4, 4]],
            )
        matrices = {"K": K, "world_to_camera": pose, "distortion": distortion}
        for key, value in matrices.items():
            check_finite(value, key, self.name)
        if self.width < 1 or self.height < 1:
            problem = f"the image size is {self.width}x{self.height}, expected at least 1x1"
            fix = "Correct the width and height in the camera file."
            raise camera_error("camera.image_size", self.name, problem, value=[self.width, self.height], fix=fix)
        if K[0, 0] <= 0 or K[1, 1] <= 0:
            raise focal_length_error(self.name, min(K[0, 0], K[1, 1]))
        if np.abs(K[(1, 2, 2, 2), (0, 0, 1, 2)] - (0, 0, 0, 1)).max() > 1e-6:
            problem = "K is not [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]"
            fix = "Correct it in the camera file."
            if np.abs(K[(0, 0, 1, 2), (1, 2, 2, 2)] - (0, 0, 0, 1)).max() <= 1:  # pixel: its origin moved
                fix = "It is transposed, as MATLAB writes it: transpose K, and R if it was written in the same way."
            raise camera_error("camera.intrinsics", self.name, problem, value=K.tolist(), fix=fix)
        rotation = pose[:3, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
            problem = "the rotation in world_to_camera is not orthonormal with determinant 1"
            fix = "Export the cameras again, without scale or mirroring in the poses."
            raise camera_error("camera.rotation", self.name, problem, fix=fix)
        lengths = _FISHEYE_LENGTHS if self.fisheye else _DISTORTION_LENGTHS
        if distortion.size not in lengths:
            raise camera_error(
                "camera.distortion",
                self.name,
                f"found {distortion.size} distortion coefficients, expected one of {lengths} as in OpenCV",
                value=distortion.size,
                fix="Add zeros up to the next of these counts.",
                expected=list(lengths),
            )
        for key, made in {**matrices, "width": int(self.width), "height": int(self.height)}.items():
            object.__setattr__(self, key, made)

    @classmethod
    def look_at(
        cls,
        eye: Sequence[float] | np.ndarray,
        target: Sequence[float] | np.ndarray,
        up: Sequence[float] | np.ndarray = (0.0, 1.0, 0.0),
        *,
        width: int,
        height: int,
        field_of_view: float = 40.0,
        name: str = "view",
    ) -> Camera:
        """A pinhole camera at `eye` that looks at `target`, (3,) in world coordinates, with the direction `up` up in
        the image.

        Args:
            up: (3,), of any length.
            width, height: image size in pixels.
            field_of_view: along the shorter side, in degrees, above 0 and below 180.

        Raises:
            StudioError: it would look along `up`, or `eye` is `target` (camera.no_direction), or another value is
                invalid (see `Camera`).
        """
        at, middle, above = (np.asarray(vector, np.float64) for vector in (eye, target, up))
        forward = middle - at
        if not np.linalg.norm(np.cross(forward, above)) > 1e-9 * np.linalg.norm(forward) * np.linalg.norm(above):
            problem = "it looks along its up direction, or at its own place"
            raise camera_error("camera.no_direction", name, problem, fix="Choose another target or up direction.")
        focal = 0.5 * min(width, height) / np.tan(np.radians(field_of_view) / 2)
        K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
        return cls(name, width, height, K, look_at_pose(at, middle, above))

    def __repr__(self) -> str:
        """One line: name, size, focal length in pixels, place and viewing direction."""
        at, looking = (", ".join(f"{value:.4g}" for value in vector) for vector in (self.center, self.forward))
        lens = "" if self.is_pinhole else f", {self.distortion.size} distortion coefficients"
        lens = ", fisheye" + lens if self.fisheye else lens
        size = f"{self.width}x{self.height}"
        return f"Camera({self.name!r}, {size}, f={self.fx:.5g}, at=({at}), looking=({looking}){lens})"

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
        """Principal point in pixels from the left image border."""
        return float(self.K[0, 2])

    @property
    def cy(self) -> float:
        """Principal point in pixels from the upper image border."""
        return float(self.K[1, 2])

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3): world-to-camera rotation."""
        return self.world_to_camera[:3, :3]

    @property
    def translation(self) -> np.ndarray:
        """(3,): world-to-camera translation."""
        return self.world_to_camera[:3, 3]

    @property
    def center(self) -> np.ndarray:
        """(3,): optical center in world coordinates."""
        return -self.rotation.T @ self.translation

    @property
    def forward(self) -> np.ndarray:
        """(3,): unit viewing direction in world coordinates."""
        return self.rotation[2]

    @property
    def is_pinhole(self) -> bool:
        """Tell whether there is no lens distortion."""
        return not self.fisheye and not np.any(self.distortion)

    @property
    def cv2_K(self) -> np.ndarray:
        """(3, 3): K in OpenCV's pixel convention (origin at the center of the top-left pixel)."""
        K = self.K.copy()
        K[:2, 2] -= 0.5
        return K

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project (N, 3) world points with lens distortion, to pixels (N, 2), origin at the image corner, and depths
        (N,) along the viewing axis. Points with depth <= 0 are behind the camera; their pixels are undefined."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        local = points @ self.rotation.T + self.translation
        depth = local[:, 2]
        safe = np.where(np.abs(depth) < 1e-12, 1e-12, depth)
        xy = local[:, :2] / safe[:, None]
        if not self.is_pinhole:
            xy = distorted(xy, self.distortion, self.fisheye)
        return xy @ self.K[:2, :2].T + self.K[:2, 2], depth

    def normalized(self, pixels: np.ndarray) -> np.ndarray:
        """(N, 2) float64 image coordinates x / z, y / z in camera axes of (N, 2) pixels, origin at the image corner;
        rows with NaN give NaN, and so do directions at 90 degrees from a fisheye's axis or more. Lens distortion is
        inverted by iteration; far outside the image it may not converge."""
        pixels = np.asarray(pixels, np.float64).reshape(-1, 2)
        if self.is_pinhole or self.fisheye:
            result: np.ndarray = np.linalg.solve(self.K, np.column_stack([pixels, np.ones(len(pixels))]).T)[:2].T
            return fisheye_undistorted(result, self.distortion) if self.fisheye else result
        import cv2

        rays = np.full_like(pixels, np.nan)
        known = np.isfinite(pixels).all(axis=1)
        if known.any():
            until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
            bent = pixels[known]
            bent[:, 0] -= self.K[0, 1] / self.fy * (bent[:, 1] - self.cy)  # skew, which OpenCV ignores
            points = cv2.undistortPoints(bent[:, None], self.K, self.distortion, criteria=until)
            rays[known] = points.reshape(-1, 2)
        return rays

    def unproject(self, pixels: np.ndarray, depth: float | np.ndarray = 1.0) -> np.ndarray:
        """The (N, 3) world points that `project` maps to (N, 2) pixels and depths, one or (N,); NaN if those are."""
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
        """The camera of the undistorted images: same K, pose and size, but no distortion.

        That of a fisheye has the same focal length, so that it resolves as much as the middle of the image, and a size
        that covers the middle row and column of the image, up to 60 degrees from the axis.
        """
        if not self.fisheye:
            return replace(self, distortion=np.zeros(0))
        ends = [[0, self.cy], [self.width, self.cy], [self.cx, 0], [self.cx, self.height]]
        left, right, top, bottom = self.normalized(np.array(ends))[[0, 1, 2, 3], [0, 0, 1, 1]]
        start = np.fmax([left, top], -_WIDEST) * [self.fx, self.fy]
        size = np.ceil(np.fmin([right, bottom], _WIDEST) * [self.fx, self.fy] - start).astype(int)
        K = np.array([[self.fx, 0, -start[0]], [0, self.fy, -start[1]], [0, 0, 1]])
        return Camera(self.name, int(size[0]), int(size[1]), K, self.world_to_camera)

    def resized(self, width: int, height: int) -> Camera:
        """Return the camera with another image size; K is scaled per axis."""
        scale = np.diag([width / self.width, height / self.height, 1.0])
        return replace(self, width=width, height=height, K=scale @ self.K)

    def scaled(self, factor: float) -> Camera:
        """Return the camera with `factor` times the image size, rounded to whole pixels (at least 1x1)."""
        return self.resized(max(1, round(self.width * factor)), max(1, round(self.height * factor)))

    def cropped(self, left: int, top: int, width: int, height: int) -> Camera:
        """The part of the image that starts at column `left` and row `top`. Exact for pinhole cameras only."""
        K = self.K.copy()
        K[0, 2] -= left
        K[1, 2] -= top
        return replace(self, width=width, height=height, K=K)

    def to_dict(self) -> JsonObject:
        """JSON-ready form, read back by `from_dict` (pixel origin at the image corner)."""
        return {
            "name": self.name,
            "width": self.width,
            "height": self.height,
            "K": self.K.tolist(),
            "world_to_camera": self.world_to_camera.tolist(),
            "distortion": self.distortion.tolist(),
            **({"fisheye": True} if self.fisheye else {}),
        }

    @classmethod
    def from_dict(cls, values: JsonObject) -> Camera:
        """Inverse of `to_dict`; StudioError: a key is missing (camera.missing_key), or as for an invalid `Camera`."""
        who = str(values.get("name", "?"))
        for key in ("name", "K", "world_to_camera"):
            if key not in values:
                raise missing_key(key, who)
        return cls(
            name=str(values["name"]),
            width=whole(values, "width", who),
            height=whole(values, "height", who),
            K=array(values["K"], "K", who),
            world_to_camera=array(values["world_to_camera"], "world_to_camera", who),
            distortion=array(values.get("distortion", []), "distortion", who),
            fisheye=bool(values.get("fisheye", False)),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Rig:
    """The cameras of a capture, in a fixed order, with unique names.

    Attributes:
        cameras: the cameras.
        notes: what the reader of a camera file assumed or left out, one sentence each.
        left_out: names of cameras that the file lists without a pose, or as not to be used. Footage of them is not
            used.
        for_evaluation: names of cameras that the file has for evaluation, not for training.

    Raises:
        StudioError: two cameras have the same name (camera.duplicate_name).
    """

    cameras: tuple[Camera, ...]
    notes: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    for_evaluation: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        seen: set[str] = set()
        for camera in self.cameras:
            if camera.name in seen:
                raise duplicate_name(camera.name)
            seen.add(camera.name)

    def __repr__(self) -> str:
        """One line per camera."""
        return "\n".join([f"Rig of {counted(len(self), 'camera')}", *(f"  {camera!r}" for camera in self.cameras)])

    def __len__(self) -> int:
        return len(self.cameras)

    def __iter__(self) -> Iterator[Camera]:
        return iter(self.cameras)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, name: str) -> Camera:
        for camera in self.cameras:
            if camera.name == name:
                return camera
        problem = f"no camera named '{name}'; the rig has {', '.join(self.names)}"
        raise StudioError("camera.unknown", problem, value=name, camera=name, expected=list(self.names))

    @property
    def names(self) -> tuple[str, ...]:
        """Camera names in rig order."""
        return tuple(camera.name for camera in self.cameras)

    @property
    def centers(self) -> np.ndarray:
        """(C, 3): optical centers in world coordinates, in rig order."""
        return np.array([camera.center for camera in self.cameras]).reshape(-1, 3)

    @property
    def up(self) -> np.ndarray:
        """(3,): normalized mean of the cameras' up directions (their negative y axes)."""
        mean = -np.mean([camera.rotation[1] for camera in self.cameras], axis=0)
        return mean / max(np.linalg.norm(mean), 1e-12)

    @property
    def focus(self) -> np.ndarray:
        """(3,): the point with the smallest sum of squared distances to the viewing axes."""
        directions = np.array([camera.forward for camera in self.cameras])
        return nearest_point_to_rays(self.centers, directions)

    def subset(self, names: Sequence[str]) -> Rig:
        """The named cameras, in the given order. Raises StudioError for an unknown name (camera.unknown)."""
        return replace(self, cameras=tuple(self[name] for name in names))


def duplicate_name(camera: str) -> StudioError:
    """The error for two cameras of one name (camera.duplicate_name)."""
    problem = f"two cameras are named '{camera}'"
    return StudioError("camera.duplicate_name", problem, value=camera, fix="Use unique camera names.", camera=camera)


def focal_length_error(camera: str, value: float) -> StudioError:
    """The error for a focal length that is not positive (camera.focal_length)."""
    problem = f"the focal length is {value:g}, expected more than 0"
    fix = "Correct it in the camera file."
    return camera_error("camera.focal_length", camera, problem, value=float(value), fix=fix)


def orbit(
    target: Sequence[float] | np.ndarray,
    distance: float,
    count: int,
    *,
    width: int,
    height: int,
    up: Sequence[float] | np.ndarray = (0.0, 1.0, 0.0),
    elevation: float = 10.0,
    field_of_view: float = 40.0,
) -> Rig:
    """Pinhole cameras on a circle, evenly spaced, all looking at a point.

    Args:
        target: (3,) the point, in world coordinates.
        distance: of the cameras from it, above 0.
        count: number of cameras, at least 1; they are named "orbit000", ....
        width, height: image size in pixels.
        up: (3,) axis of the circle, of any length.
        elevation: of the cameras above the point, in degrees, between -90 and 90.
        field_of_view: along the shorter side, in degrees.

    Raises:
        StudioError: see `Camera.look_at`.
    """
    axis = np.asarray(up, np.float64) / np.linalg.norm(up)
    front = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    front /= np.linalg.norm(front)
    side = np.cross(axis, front)
    height_above, radius = np.sin(np.radians(elevation)), np.cos(np.radians(elevation))
    cameras = []
    for number in range(count):
        angle = 2 * np.pi * number / count
        outwards = radius * (np.cos(angle) * front + np.sin(angle) * side) + height_above * axis
        eye = np.asarray(target, np.float64) + distance * outwards
        cameras.append(
            Camera.look_at(
                eye, target, axis, width=width, height=height, field_of_view=field_of_view, name=f"orbit{number:03d}"
            )
        )
    return Rig(tuple(cameras))


def look_at_pose(eye: np.ndarray, target: np.ndarray, up: np.ndarray) -> np.ndarray:
    """World-to-camera matrix (4, 4) float64 of an upright camera at `eye` whose viewing axis goes through `target`,
    (3,) world coordinates, not equal. `up`: (3,) direction of any length that is not parallel to it."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = -rotation @ eye
    return pose


def nearest_point_to_rays(origins: np.ndarray, directions: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """The point, (3,) float64, with the smallest sum of squared distances to lines in space, infinite in both
    directions; of several (the lines are parallel), the one with the smallest norm.

    `origins`, `directions`, (N, 3): a point and the unit direction of each line; `weights`, (N,), of the squared
    distances; None: all 1.
    """
    projectors = np.eye(3)[None] - directions[:, :, None] * directions[:, None, :]
    if weights is not None:
        projectors = weights[:, None, None] * projectors
    matrix, right = projectors.sum(0), np.einsum("cij,cj->i", projectors, origins)
    point: np.ndarray = np.linalg.lstsq(matrix, right, rcond=1e-6)[0]
    return point


@dataclass(frozen=True, eq=False)
class FootageView:
    """One frame of one camera.

    Attributes:
        camera: pinhole camera of the image.
        image: (H, W, 3) uint8 RGB.
        mask: (H, W) uint8, 255 = foreground.
        frame: frame number.
        plate: image of the empty set, (H, W, 3) uint8 RGB, or (H, W, 4) if the fourth channel is 0 where it is not
            reliable; None if it is not known.
        doubted: (H, W) bool, where the difference from the plate contradicts the mask; None: nowhere.
    """

    camera: Camera
    image: np.ndarray
    mask: np.ndarray
    frame: int = 0
    plate: np.ndarray | None = None
    doubted: np.ndarray | None = None

    __repr__ = short_repr
