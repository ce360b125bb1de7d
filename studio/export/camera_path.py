"""Cameras keyed in time, smooth between the keys; and the turntable, which circles the subject once.

A path's file (JSON)::

    {"format": "v3studio-camera-path", "version": 1,
     "keys": [{"time": 0.0, "camera": {"name", "width", "height", "K", "world_to_camera", "distortion"}, "frame": 0},
              ...]}

`time` is in seconds of the made video, ascending; `camera` as in rig.json; `frame`, optional but then in all keys, the
frame of the Gaussian video that is shown at that time (it may stand still or run backwards). Without it the video
plays at its own rate, again and again. A rig.json or cameras.json is taken as a path, too: one camera after another.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.spatial.transform import Rotation, RotationSpline

from studio.camera_files import read_rig
from studio.camera_files.common import read_json
from studio.cameras import Camera, Rig, look_at_pose
from studio.errors import StudioError
from studio.splat_video import SplatVideo

FORMAT = "v3studio-camera-path"
VERSION = 1
_SAMPLED_FRAMES = 5  # of the video, to find where the subject is


@dataclass(frozen=True, eq=False)
class Key:
    """A camera at a time. Attributes: time in seconds; camera; frame of the Gaussian video, or None."""

    time: float
    camera: Camera
    frame: float | None = None


class CameraPath:
    """Cameras over time: positions by a natural cubic spline, rotations by a cubic rotation spline (both without jerks
    in speed), focal lengths and frames without overshoot. At a key's time the camera is exactly the key's.

    Args:
        keys: at least one, times ascending.
        width, height: of all pictures; keys of another shape are refused.

    Raises:
        StudioError: no keys, times that do not ascend, cameras of other shapes, or frames in some keys only.
    """

    def __init__(self, keys: Sequence[Key], width: int, height: int) -> None:
        if not keys:
            raise StudioError("A camera path needs at least one key.")
        self._times = np.array([key.time for key in keys], np.float64)
        if not np.isfinite(self._times).all() or (np.diff(self._times) <= 0).any():
            raise StudioError(f"The times of a camera path must ascend; found {self._times.tolist()}.")
        frames = [key.frame for key in keys if key.frame is not None]
        if frames and len(frames) < len(keys):
            raise StudioError("Give a frame in all keys of a camera path, or in none.")
        cameras = [_fitted(key.camera, width, height) for key in keys]
        self._cameras = cameras
        self._frames = frames
        lens = np.log([[camera.fx, camera.fy] for camera in cameras])
        if len(keys) > 1:
            self._centers = CubicSpline(self._times, [camera.center for camera in cameras], bc_type="natural")
            self._rotations = RotationSpline(self._times, Rotation.from_matrix([c.rotation for c in cameras]))
            self._lens = PchipInterpolator(self._times, lens)
            self._middle = PchipInterpolator(self._times, [[camera.cx, camera.cy] for camera in cameras])
            self._frame = PchipInterpolator(self._times, frames) if frames else None

    @property
    def duration(self) -> float:
        """Seconds from the first key to the last."""
        return float(self._times[-1] - self._times[0])

    @property
    def has_frames(self) -> bool:
        """Whether the keys say which frame is shown."""
        return bool(self._frames)

    def camera(self, seconds: float) -> Camera:
        """The camera so long after the first key; before the first and after the last key it stands."""
        if len(self._cameras) == 1:
            return self._cameras[0]
        time = float(np.clip(self._times[0] + seconds, self._times[0], self._times[-1]))
        rotation = self._rotations(time).as_matrix()
        pose = np.eye(4)
        pose[:3, :3] = rotation
        pose[:3, 3] = -rotation @ self._centers(time)
        fx, fy = np.exp(self._lens(time))
        cx, cy = self._middle(time)
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        first = self._cameras[0]
        return Camera(f"path at {seconds:.3f} s", first.width, first.height, K, pose)

    def frame(self, seconds: float) -> float:
        """Frame of the Gaussian video at that time; only where `has_frames`."""
        if len(self._cameras) == 1:
            return float(self._frames[0])
        assert self._frame is not None
        return float(self._frame(np.clip(self._times[0] + seconds, self._times[0], self._times[-1])))


def _fitted(camera: Camera, width: int, height: int) -> Camera:
    """The camera at another size of the same shape, without lens distortion and skew (splats are drawn so)."""
    if abs(camera.width / camera.height / (width / height) - 1) > 0.01:
        raise StudioError(
            f"Camera '{camera.name}' has the shape {camera.width}x{camera.height}, the video {width}x{height}; "
            "give a size of the same shape."
        )
    K = camera.K.copy()
    K[0, 1] = 0.0
    return replace(camera, K=K).undistorted().resized(width, height)


def read_path_keys(path: Path, seconds: float) -> list[Key]:
    """Keys of a camera path's file, or of the cameras of a rig's, spread evenly over `seconds`.

    Raises:
        StudioError: not there, not JSON, another format or version, or a key without time or camera.
    """
    values = read_json(path)
    if values.get("format") != FORMAT:
        rig = read_rig(path)
        return _rig_keys(rig, seconds)
    if values.get("version") != VERSION:
        raise StudioError(
            f"{path}: version {values.get('version')!r} found, this program reads {VERSION}; update V3 Studio."
        )
    entries = values.get("keys")
    if not isinstance(entries, list) or not entries:
        raise StudioError(f"{path}: 'keys' must be a list with at least one key.")
    return [_key(f"{path}: key {index}", entry) for index, entry in enumerate(entries)]


def _rig_keys(rig: Rig, seconds: float) -> list[Key]:
    step = seconds / max(len(rig) - 1, 1)
    return [Key(index * step, camera) for index, camera in enumerate(rig)]


def _key(where: str, entry: Any) -> Key:
    if not isinstance(entry, dict) or not isinstance(entry.get("camera"), dict):
        raise StudioError(f"{where} has no 'camera'; give one as in rig.json.")
    numbers = {}
    for name in ("time", "frame"):
        value = entry.get(name)
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
            raise StudioError(f"{where}: '{name}' is {value!r}; it must be a number.")
        numbers[name] = value
    if numbers["time"] is None:
        raise StudioError(f"{where} has no 'time'; give the seconds from the start of the video.")
    return Key(float(numbers["time"]), Camera.from_dict(entry["camera"]), numbers["frame"])


def path_to_json(keys: Sequence[Key]) -> dict[str, Any]:
    """What `read_path_keys` reads."""
    entries = []
    for key in keys:
        entry: dict[str, Any] = {"time": key.time, "camera": key.camera.to_dict()}
        if key.frame is not None:
            entry["frame"] = key.frame
        entries.append(entry)
    return {"format": FORMAT, "version": VERSION, "keys": entries}


def subject_sphere(video: SplatVideo) -> tuple[np.ndarray, float]:
    """Center (3,) and radius of the sphere that the visible subject moves in: of a few frames, splats that are half
    transparent or more and the outermost 2 % left out, so that strays do not count."""
    points = []
    for index in np.unique(np.linspace(0, video.frame_count - 1, _SAMPLED_FRAMES).round().astype(int)):
        gaussians = video.read(int(index))
        solid = gaussians.opacities > 0.5
        points.append((gaussians.means[solid] if solid.any() else gaussians.means).detach().cpu().double().numpy())
    everything = np.concatenate(points)
    low, high = np.percentile(everything, [2, 98], axis=0)
    center = (low + high) / 2
    radius = float(np.percentile(np.linalg.norm(everything - center, axis=1), 98))
    return center, max(radius, 1e-6)


def turntable(
    video: SplatVideo,
    width: int,
    height: int,
    turns: float = 1.0,
    elevation: float = 10.0,
    field_of_view: float = 40.0,
) -> Callable[[float], Camera]:
    """A camera that circles the subject, as far away as shows all of it.

    Args:
        video: tells where the subject is, what is up, and from where to start (its view's side).
        width, height: of the pictures.
        turns: how often round; negative goes the other way.
        elevation: degrees above the subject's middle, -89 to 89.
        field_of_view: degrees, of the shorter side.

    Returns:
        The camera at a share (0 to 1) of the whole way.

    Raises:
        StudioError: an angle out of range.
    """
    if not -89 <= elevation <= 89:
        raise StudioError(f"The turntable's elevation is {elevation}; give degrees from -89 to 89.")
    if not 1 <= field_of_view <= 150:
        raise StudioError(f"The turntable's field of view is {field_of_view}; give degrees from 1 to 150.")
    center, radius = subject_sphere(video)
    from studio.export.rigid_motion import upright

    right, up, front = upright(video)
    focal = min(width, height) / 2 / math.tan(math.radians(field_of_view) / 2)
    distance = 1.08 * radius / math.sin(math.radians(field_of_view) / 2)
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    level, lift = math.cos(math.radians(elevation)), math.sin(math.radians(elevation))

    def camera(share: float) -> Camera:
        angle = 2 * math.pi * turns * share
        outwards = level * (math.cos(angle) * front + math.sin(angle) * right) + lift * up
        return look_at(f"turntable {share:.4f}", width, height, K, center + distance * outwards, center, up)

    return camera


def look_at(
    name: str, width: int, height: int, K: np.ndarray, eye: np.ndarray, target: np.ndarray, up: np.ndarray
) -> Camera:
    """A camera at `eye` whose axis goes through `target`, upright. `up` must not lie along that axis."""
    return Camera(name, width, height, K, look_at_pose(eye, target, up))
