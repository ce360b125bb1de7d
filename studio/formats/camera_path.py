"""Camera paths with smooth interpolation between keys, and a turntable path around the subject.

File format (JSON)::

    {"format": "v3studio-camera-path", "version": 1,
     "keys": [{"time": 0.0, "camera": {"name", "width", "height", "K", "world_to_camera", "distortion"}, "frame": 0},
              ...]}

`time` is the time in the movie in seconds, ascending; `camera` has the format of rig.json; `frame` is the frame of the
splat video shown at that time (it may pause or run backwards), set in all keys or in none. Without it, the splat video
loops at its own rate. `easing` says how the camera moves to the next key: "smooth" (the default: on a curve through all
keys, without a stop), "ease" (on this curve, slowly away from the key and slowly to the next one), "linear" (straight,
at a constant speed) or "hold" (stays, then cuts). A rig.json or cameras.json is accepted as a path through its cameras.

Files of film tools are read as well (`FILM_FORMATS`): their cameras have one place for each frame of the footage.
"""

import importlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, get_args

import numpy as np
from pydantic import BaseModel, FailFast, Field, ValidationError
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation, RotationSpline, Slerp

from v3studio.studio.atomic_files import write_json
from v3studio.studio.camera_files import read_rig
from v3studio.studio.camera_files.common import read_json
from v3studio.studio.cameras import Camera, look_at_pose
from v3studio.studio.errors import StudioError, first_violation, naming
from v3studio.studio.formats import USD_SUFFIXES
from v3studio.studio.json_types import JsonObject
from v3studio.studio.splat_video import SplatVideo

FORMAT = "v3studio-camera-path"
VERSION = 1
Easing = Literal["smooth", "ease", "linear", "hold"]
EASINGS: tuple[Easing, ...] = get_args(Easing)

FILM_FORMATS = {".nk": "nuke_cameras"} | dict.fromkeys(USD_SUFFIXES, "usd_cameras")
"""Modules of `studio.formats` that read cameras of film tools, by suffix: `read_cameras(path, width, height)` returns
the cameras by name and frame number, with y up and in meters."""

_FIELD_OF_VIEW = math.radians(40)  # of the turntable, along the shorter side
_SAMPLED_FRAMES = 5  # frames of the video from which the subject is located


@dataclass(frozen=True, eq=False)
class Key:
    """A camera at a `time` in seconds. `frame` of the splat video: None if it plays at its own rate. `easing`: how the
    camera moves to the next key."""

    time: float
    camera: Camera
    frame: float | None = None
    easing: Easing = "smooth"


class CameraPath:
    """A camera over time that passes exactly through its keys.

    Positions follow a natural cubic spline and rotations a cubic rotation spline, both with continuous velocity; focal
    lengths and frames are interpolated monotonically. `Key.easing` changes how the camera moves, but not the frames.

    Args:
        keys: at least one key, with ascending times.
        width, height: size of the images in pixels; the cameras of all keys must have the same aspect ratio.

    Raises:
        StudioError: there are no keys (camera_path.no_keys), their times are not ascending (camera_path.times), a
            camera has another aspect ratio (camera_path.aspect_ratio), or only some keys have a frame
            (camera_path.frames).
    """

    def __init__(self, keys: Sequence[Key], width: int, height: int) -> None:
        if not keys:
            raise StudioError("camera_path.no_keys", "a camera path needs at least one key")
        self._times = np.array([key.time for key in keys], np.float64)
        if not np.isfinite(self._times).all() or (np.diff(self._times) <= 0).any():
            times = self._times.tolist()
            problem = f"times must be ascending; found {times}"
            fix = "Give each key a later time than the one before it."
            raise StudioError("camera_path.times", problem, value=times, fix=fix)
        frames = [key.frame for key in keys if key.frame is not None]
        if frames and len(frames) < len(keys):
            problem = "only some of the keys have a frame"
            raise StudioError("camera_path.frames", problem, fix="Set frame in all keys or in none.")
        self._easings = [key.easing for key in keys]
        cameras = [_fitted(key.camera, width, height) for key in keys]
        self._cameras = cameras
        self._frames = frames
        focal_lengths = np.log([[camera.fx, camera.fy] for camera in cameras])
        if len(keys) > 1:
            self._centers = CubicSpline(self._times, [camera.center for camera in cameras], bc_type="natural")
            self._rotations = RotationSpline(self._times, Rotation.from_matrix([c.rotation for c in cameras]))
            self._focal_lengths = PchipInterpolator(self._times, focal_lengths)
            self._middle = PchipInterpolator(self._times, [[camera.cx, camera.cy] for camera in cameras])
            self._frame = PchipInterpolator(self._times, frames) if frames else None

    @property
    def duration(self) -> float:
        """Time from the first to the last key in seconds."""
        return float(self._times[-1] - self._times[0])

    @property
    def has_frames(self) -> bool:
        """Tell whether the keys set the frame to show."""
        return bool(self._frames)

    def camera(self, seconds: float) -> Camera:
        """The camera `seconds` after the first key; constant before the first and after the last key."""
        if len(self._cameras) == 1:
            return self._cameras[0]
        time = float(np.clip(self._times[0] + seconds, self._times[0], self._times[-1]))
        time, straight = self._eased(time)
        rotation = self._rotations(time).as_matrix()
        center = self._centers(time)
        if straight is not None:
            ends = self._times[straight : straight + 2]
            share = (time - ends[0]) / (ends[1] - ends[0])
            center = (1 - share) * self._centers(ends[0]) + share * self._centers(ends[1])
            rotation = Slerp(ends, self._rotations(ends))(time).as_matrix()
        pose = np.column_stack([rotation, -rotation @ center])
        fx, fy = np.exp(self._focal_lengths(time))
        cx, cy = self._middle(time)
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        first = self._cameras[0]
        return Camera(f"path at {seconds:.3f} s", first.width, first.height, K, pose)

    def _eased(self, time: float) -> tuple[float, int | None]:
        """The camera's place on the curve at a time, and the segment that it moves straight along, if it does."""
        segment = min(int(np.searchsorted(self._times, time, side="right")) - 1, len(self._times) - 2)
        start, end = self._times[segment : segment + 2]
        share, easing = (time - start) / (end - start), self._easings[segment]
        if easing == "hold":
            return float(start if share < 1 else end), None
        if easing == "ease":
            return float(start + share * share * (3 - 2 * share) * (end - start)), None
        return time, segment if easing == "linear" else None

    def frame(self, seconds: float) -> float:
        """The frame of the splat video `seconds` after the first key; requires `has_frames`."""
        if len(self._cameras) == 1:
            return float(self._frames[0])
        assert self._frame is not None
        return float(self._frame(np.clip(self._times[0] + seconds, self._times[0], self._times[-1])))

    def seconds_of(self, frame: float) -> float:
        """The time at which the path shows a frame: seconds after the first key, at the first or the last key for
        frames outside."""
        if (np.diff(self._frames) <= 0).any():
            problem = "the frames of the keys repeat or decrease, so that a frame has no camera of its own"
            fix = "Use ascending frames, or no frames, in the camera path."
            raise StudioError("camera_path.frames_not_ascending", problem, value=list(self._frames), fix=fix)
        if len(self._cameras) == 1:
            return 0.0
        shown = self._frame
        assert shown is not None
        wanted = float(np.clip(frame, self._frames[0], self._frames[-1]))
        start = self._times[0]
        return float(brentq(lambda time: shown(time) - wanted, start, self._times[-1], xtol=1e-9) - start)


def _fitted(camera: Camera, width: int, height: int) -> Camera:
    """The camera at another size of the same aspect ratio, without lens distortion and skew, for the rasterizer."""
    if abs(camera.width / camera.height / (width / height) - 1) > 0.01:
        problem = f"camera {camera.name} is {camera.width}x{camera.height}, another aspect ratio than {width}x{height}"
        value = (camera.width, camera.height)
        fix = "Choose a size with the same aspect ratio."
        raise StudioError(
            "camera_path.aspect_ratio", problem, value=value, fix=fix, camera=camera.name, expected=(width, height)
        )
    K = camera.K.copy()
    K[0, 1] = 0.0
    return replace(camera, K=K).undistorted().resized(width, height)


class _FileKey(BaseModel):
    time: Annotated[float, Field(strict=True)]
    camera: JsonObject
    frame: Annotated[float | None, Field(strict=True, ge=-1e9, le=1e9)] = None
    easing: Easing = "smooth"


class _File(BaseModel):
    keys: Annotated[list[_FileKey], FailFast(), Field(min_length=1)]  # a file may have millions of mistakes


def read_path_keys(path: Path, seconds: float) -> list[Key]:
    """The keys of a camera path file, or the cameras of a rig file as keys spread evenly over `seconds`."""
    values = read_json(path)
    if values.get("format") != FORMAT:
        rig = read_rig(path)
        step = seconds / max(len(rig) - 1, 1)
        return [Key(index * step, camera) for index, camera in enumerate(rig)]
    if values.get("version") != VERSION:
        problem = f"the version is {values.get('version')!r}; only version {VERSION} is supported"
        value = values.get("version")
        fix = "Update V3 Studio."
        raise StudioError("camera_path.unsupported_version", problem, file=path, value=value, fix=fix, expected=VERSION)
    try:
        keys = _File.model_validate(values).keys
    except ValidationError as error:
        name, problem = first_violation(error)
        fix = "docs/guides/export-import.md describes the format."
        raise StudioError("camera_path.invalid_key", problem, file=path, fix=fix, name=name) from None
    with naming(path):
        return [Key(entry.time, Camera.from_dict(entry.camera), entry.frame, entry.easing) for entry in keys]


def read_film_keys(
    path: Path, name: str | None, size: tuple[int, int], numbers: Sequence[int], fps: float
) -> list[Key]:
    """The keys of a camera in a file of a film tool: one for each of its frames, or one if it stands still.

    Frames between those of the video are left out; keys before and after the video have frames outside of it. `name` of
    the camera: None if there is only one; `size` of the image, for formats without it; `numbers`: of the video's
    frames, ascending.
    """
    module = importlib.import_module(f"v3studio.studio.formats.{FILM_FORMATS[path.suffix.lower()]}")
    by_name: dict[str, dict[int, Camera]] = module.read_cameras(path, *size)
    if (name is None and len(by_name) > 1) or (name is not None and name not in by_name):
        problem = f"the file has the cameras {', '.join(by_name)}" + ("" if name is None else f", not '{name}'")
        fix = "Choose one with --camera NAME."
        raise StudioError("camera_path.which_camera", problem, file=path, value=name, fix=fix, expected=list(by_name))
    cameras = by_name[name or next(iter(by_name))]
    if len(cameras) == 1:
        return [Key(0.0, next(iter(cameras.values())))]
    moves, filmed = [min(cameras), max(cameras)], [numbers[0], numbers[-1]]
    if moves[1] < filmed[0] or moves[0] > filmed[1]:
        problem = f"the camera moves in frames {moves[0]} to {moves[1]}; the footage has {filmed[0]} to {filmed[1]}"
        fix = "Say with --start-number which number the first frame has in the film tool."
        raise StudioError("camera_path.other_frames", problem, file=path, value=moves, fix=fix, expected=filmed)
    step = numbers[1] - numbers[0] if len(numbers) > 1 else 1
    frames = [number for number in sorted(cameras) if (number - numbers[0]) % step == 0]
    indices = {number: (number - numbers[0]) // step for number in frames}
    return [Key(index / fps, cameras[number], index, "linear") for number, index in indices.items()]


def write_path_keys(keys: Sequence[Key], path: Path) -> None:
    """Write a camera path that `read_path_keys` reads, atomically; it survives a power cut. Raises OSError."""
    entries = []
    for key in keys:
        entry: JsonObject = {"time": key.time, "camera": key.camera.to_dict()}
        if key.frame is not None:
            entry["frame"] = key.frame
        if key.easing != "smooth":
            entry["easing"] = key.easing
        entries.append(entry)
    write_json(path, {"format": FORMAT, "version": VERSION, "keys": entries}, durable=True)


def subject_sphere(video: SplatVideo) -> tuple[np.ndarray, float]:
    """Center (3,) and radius, in world units, of a sphere around the subject in a few sampled frames.

    Splats with an opacity of 0.5 or less and the outermost 2% are ignored, to exclude floaters.
    """
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
    video: SplatVideo, width: int, height: int, turns: float = 1.0, elevation: float = 10.0
) -> Callable[[float], Camera]:
    """A function from a fraction of the path (0 to 1) to a camera that circles the subject, all of which it sees.

    Args:
        video: provides the subject, the up direction and the side from which the path starts (that of its view).
        turns: number of turns; negative for the opposite direction.
        elevation: angle above the subject's center in degrees, -89 to 89.
    """
    if not -89 <= elevation <= 89:
        problem = f"elevation is {elevation} degrees; it must be -89 to 89"
        raise StudioError("export.invalid_elevation", problem, value=elevation)
    center, radius = subject_sphere(video)
    from v3studio.studio.formats.rigid_motion import upright

    right, up, front = upright(video)
    focal = min(width, height) / 2 / math.tan(_FIELD_OF_VIEW / 2)
    distance = 1.08 * radius / math.sin(_FIELD_OF_VIEW / 2)
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    level, lift = math.cos(math.radians(elevation)), math.sin(math.radians(elevation))

    def camera(fraction: float) -> Camera:
        angle = 2 * math.pi * turns * fraction
        outwards = level * (math.cos(angle) * front + math.sin(angle) * right) + lift * up
        pose = look_at_pose(center + distance * outwards, center, up)
        return Camera(f"turntable {fraction:.4f}", width, height, K, pose)

    return camera
