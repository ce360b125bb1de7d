"""transforms.json of instant-ngp, nerfstudio, NeuS2 and VideoGS.

Each of the `frames[]` has a `file_path` and a `transform_matrix`, camera to world with OpenGL axes (x right, y up, z
back); with `"from_na": true` (NeuS2), the axes are OpenCV's. Intrinsics are at the top level or in each frame: `fl_x`,
`fl_y` or `camera_angle_x`, `camera_angle_y`, or a matrix `intrinsic_matrix` or `K`; `cx`, `cy`, `w`, `h`; distortion
`k1 k2 p1 p2 k3` of OpenCV's model (`k4` belongs to fisheye lenses, which are not supported). The pixel origin is the
image corner, as in COLMAP, since these files are usually converted from COLMAP models.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from studio.camera_files.common import (
    camera_names,
    fisheye,
    matrix,
    naming,
    no_cameras,
    read_json,
    rigid_inverse,
    write_atomic,
)
from studio.cameras import Camera, Rig
from studio.capture.images import image_size
from studio.errors import StudioError
from studio.json_types import JsonObject
from studio.validation import missing_key, number

_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
_SUFFIXES = ("", ".png", ".jpg", ".jpeg", ".webp", ".exr")


def _image_size(path: Path, file: str) -> tuple[int, int] | None:
    """Width and height of an image next to the JSON file; None if it is missing or unreadable."""
    for suffix in _SUFFIXES:
        candidate = path.parent / (file + suffix)
        if candidate.is_file():
            try:
                return image_size(candidate)
            except StudioError as error:
                if error.code.startswith("storage."):
                    raise
                return None
    return None


def _size(values: JsonObject, path: Path, file: str, camera: str) -> tuple[int, int]:
    width, height = values.get("w", values.get("width")), values.get("h", values.get("height"))
    if width is None or height is None:
        found = _image_size(path, file)
        if found is None:
            raise StudioError(
                "camera.size_unknown",
                f"Camera '{camera}': the file does not contain 'w' and 'h', and there is no image '{file}' next to it",
                value=file,
                fix="Add 'w' and 'h', or put the images next to the file.",
                camera=camera,
            )
        return found
    pair = {"w": width, "h": height}
    return round(number(pair, "w", camera)), round(number(pair, "h", camera))


def _intrinsics(values: JsonObject, width: int, height: int, camera: str) -> np.ndarray:
    for key in ("intrinsic_matrix", "K"):
        if key in values:
            rows = values[key]
            columns = len(rows[0]) if isinstance(rows, list) and rows and isinstance(rows[0], list) else 3
            return matrix(rows, (3, 4), 4 if columns == 4 else 3, key, camera)[:3, :3]
    focal: dict[str, float] = {}
    for key, angle, side in (("fl_x", "camera_angle_x", width), ("fl_y", "camera_angle_y", height)):
        if key in values:
            focal[key] = number(values, key, camera)
        elif angle in values:
            radians = number(values, angle, camera)
            if not 0 < radians < np.pi:
                raise StudioError(
                    "camera.field_of_view",
                    f"Camera '{camera}': '{angle}' is {radians:g}, expected a value between 0 and pi",
                    value=radians,
                    fix="Correct it in the camera file; angles are in radians.",
                    camera=camera,
                    key=angle,
                )
            focal[key] = 0.5 * side / np.tan(0.5 * radians)
    if "fl_x" not in focal:
        raise missing_key("fl_x", camera)
    cx, cy = number(values, "cx", camera, width / 2), number(values, "cy", camera, height / 2)
    return np.array([[focal["fl_x"], 0, cx], [0, focal.get("fl_y", focal["fl_x"]), cy], [0, 0, 1]])


def _distortion(values: JsonObject, camera: str) -> np.ndarray:
    model = str(values.get("camera_model", "OPENCV")).upper()
    if values.get("is_fisheye") or "FISHEYE" in model or number(values, "k4", camera, 0.0) != 0:
        raise fisheye(camera)
    k1, k2, p1, p2, k3 = (number(values, key, camera, 0.0) for key in ("k1", "k2", "p1", "p2", "k3"))
    if k3:
        return np.array([k1, k2, p1, p2, k3])
    return np.array([k1, k2, p1, p2]) if any((k1, k2, p1, p2)) else np.zeros(0)


def rig_from_transforms(path: Path, values: JsonObject) -> Rig:
    """A rig from the JSON object in the file.

    Raises:
        StudioError: there are no frames (camera_file.no_cameras), or a camera is invalid (camera.*).
    """
    with naming(path):
        frames = values.get("frames")
        if not isinstance(frames, list) or not frames:
            raise no_cameras("the list 'frames' is missing or empty")
        for index, frame in enumerate(frames):
            if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
                raise missing_key("file_path", f"number {index}")
        names = camera_names([frame["file_path"] for frame in frames])
        cameras = []
        for name, frame in zip(names, frames, strict=True):
            if "transform_matrix" not in frame:
                raise missing_key("transform_matrix", name)
            pose = matrix(frame["transform_matrix"], (3, 4), 4, "transform_matrix", name)
            both = {**values, **frame}
            if not values.get("from_na"):
                pose = pose @ _FLIP
            width, height = _size(both, path, frame["file_path"], name)
            cameras.append(
                Camera(
                    name,
                    width,
                    height,
                    _intrinsics(both, width, height, name),
                    rigid_inverse(pose),
                    _distortion(both, name),
                )
            )
        return Rig(tuple(cameras))


def read_transforms(path: Path) -> Rig:
    """Read transforms.json. Raises StudioError as `rig_from_transforms`."""
    return rig_from_transforms(path, read_json(path))


def write_transforms(rig: Rig, path: Path, *, image_pattern: str = "images/{camera}.png") -> None:
    """Write transforms.json atomically, with intrinsics per camera.

    Args:
        rig: cameras with at most the distortion terms k1 k2 p1 p2 k3.
        path: the file.
        image_pattern: pattern of `file_path`, relative to the file.

    Raises:
        StudioError: a camera has skew or more distortion terms (camera_file.not_expressible), or the file cannot be
            written (camera_file.unwritable).
    """
    frames = []
    for camera in rig:
        if np.any(camera.distortion[5:]):
            raise StudioError(
                "camera_file.not_expressible",
                f"Camera '{camera.name}': transforms.json only supports the distortion terms k1 k2 p1 p2 k3, but "
                f"this camera has {camera.distortion.size} terms",
                file=path,
                value=camera.distortion.size,
                fix="Undistort the images first, or write rig.json.",
                camera=camera.name,
            )
        if abs(camera.K[0, 1]) > 1e-9:
            raise StudioError(
                "camera_file.not_expressible",
                f"Camera '{camera.name}': transforms.json cannot express skew ({camera.K[0, 1]:g})",
                file=path,
                value=float(camera.K[0, 1]),
                fix="Calibrate without skew, or write rig.json.",
                camera=camera.name,
            )
        distortion = dict(zip(("k1", "k2", "p1", "p2", "k3"), camera.distortion[:5].tolist(), strict=False))
        frames.append(
            {
                "file_path": image_pattern.format(camera=camera.name),
                "w": camera.width,
                "h": camera.height,
                "fl_x": camera.fx,
                "fl_y": camera.fy,
                "cx": camera.cx,
                "cy": camera.cy,
                **distortion,
                "transform_matrix": (rigid_inverse(camera.world_to_camera) @ _FLIP).tolist(),
            }
        )
    write_atomic(path, (json.dumps({"camera_model": "OPENCV", "frames": frames}, indent=1) + "\n").encode())
