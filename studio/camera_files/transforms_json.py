"""transforms.json as instant-ngp, nerfstudio, NeuS2 and VideoGS write it.

`frames[]` hold `file_path` and `transform_matrix`, camera to world with OpenGL axes (x right, y up, z back); with
`"from_na": true` (NeuS2) the axes are OpenCV's. Intrinsics stand at the top or in each frame: `fl_x`, `fl_y` or
`camera_angle_x`, `camera_angle_y`, or a matrix `intrinsic_matrix` or `K`; `cx`, `cy`, `w`, `h`; distortion
`k1 k2 p1 p2 k3` in OpenCV's model (`k4` is the fisheye's, which is refused). The pixel origin is the image corner, as
in COLMAP, from whose files these come.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from studio.camera_files.common import camera_names, matrix, naming, read_json, rigid_inverse, write_atomic
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.validation import number

_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
_SUFFIXES = ("", ".png", ".jpg", ".jpeg", ".webp", ".exr")


def _image_size(path: Path, file: str) -> tuple[int, int] | None:
    """Width and height of an image beside the JSON file, if it is there."""
    from PIL import Image

    for suffix in _SUFFIXES:
        candidate = path.parent / (file + suffix)
        if candidate.is_file():
            try:
                with Image.open(candidate) as image:
                    return image.size
            except OSError:
                return None
    return None


def _size(values: dict[str, Any], path: Path, file: str, who: str) -> tuple[int, int]:
    width, height = values.get("w", values.get("width")), values.get("h", values.get("height"))
    if width is None or height is None:
        found = _image_size(path, file)
        if found is None:
            raise StudioError(
                f"{who}: 'w' and 'h' are missing and the image '{file}' is not beside the file; add them."
            )
        return found
    pair = {"w": width, "h": height}
    return round(number(pair, "w", who)), round(number(pair, "h", who))


def _intrinsics(values: dict[str, Any], width: int, height: int, who: str) -> np.ndarray:
    for key in ("intrinsic_matrix", "K"):
        if key in values:
            rows = values[key]
            columns = len(rows[0]) if isinstance(rows, list) and rows and isinstance(rows[0], list) else 3
            return matrix(rows, (3, 4), 4 if columns == 4 else 3, key, who)[:3, :3]
    focal: dict[str, float] = {}
    for key, angle, side in (("fl_x", "camera_angle_x", width), ("fl_y", "camera_angle_y", height)):
        if key in values:
            focal[key] = number(values, key, who)
        elif angle in values:
            radians = number(values, angle, who)
            if not 0 < radians < np.pi:
                raise StudioError(f"{who}: '{angle}' is {radians:g}; a field of view lies between 0 and pi.")
            focal[key] = 0.5 * side / np.tan(0.5 * radians)
    if "fl_x" not in focal:
        raise StudioError(f"{who}: neither 'fl_x' nor 'camera_angle_x' nor 'intrinsic_matrix' is given.")
    cx, cy = number(values, "cx", who, width / 2), number(values, "cy", who, height / 2)
    return np.array([[focal["fl_x"], 0, cx], [0, focal.get("fl_y", focal["fl_x"]), cy], [0, 0, 1]])


def _distortion(values: dict[str, Any], who: str) -> np.ndarray:
    model = str(values.get("camera_model", "OPENCV")).upper()
    if values.get("is_fisheye") or "FISHEYE" in model or number(values, "k4", who, 0.0) != 0:
        raise StudioError(f"{who}: fisheye lenses are not supported; undistort the images to a pinhole camera first.")
    k1, k2, p1, p2, k3 = (number(values, key, who, 0.0) for key in ("k1", "k2", "p1", "p2", "k3"))
    if k3:
        return np.array([k1, k2, p1, p2, k3])
    return np.array([k1, k2, p1, p2]) if any((k1, k2, p1, p2)) else np.zeros(0)


def rig_from_transforms(path: Path, values: dict[str, Any]) -> Rig:
    """A rig from the object that the file holds.

    Raises:
        StudioError: a key is missing, a value is unusable, two frames have one file_path.
    """
    with naming(path):
        frames = values.get("frames")
        if not isinstance(frames, list) or not frames:
            raise StudioError("the list 'frames' is missing or empty; export the cameras again.")
        for index, frame in enumerate(frames):
            if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
                raise StudioError(f"frame {index} has no 'file_path'.")
        names = camera_names([frame["file_path"] for frame in frames])
        cameras = []
        for name, frame in zip(names, frames, strict=True):
            who = f"Camera '{name}'"
            if "transform_matrix" not in frame:
                raise StudioError(f"{who}: the key 'transform_matrix' is missing.")
            pose = matrix(frame["transform_matrix"], (3, 4), 4, "transform_matrix", who)
            both = {**values, **frame}
            if not values.get("from_na"):
                pose = pose @ _FLIP
            width, height = _size(both, path, frame["file_path"], who)
            cameras.append(
                Camera(
                    name,
                    width,
                    height,
                    _intrinsics(both, width, height, who),
                    rigid_inverse(pose),
                    _distortion(both, who),
                )
            )
        return Rig(tuple(cameras))


def read_transforms(path: Path) -> Rig:
    """Read transforms.json. Raises StudioError."""
    return rig_from_transforms(path, read_json(path))


def write_transforms(rig: Rig, path: Path, *, image_pattern: str = "images/{camera}.png") -> None:
    """Write transforms.json with each camera's own intrinsics, atomically.

    Args:
        rig: cameras with no more distortion than k1 k2 p1 p2 k3.
        path: the file.
        image_pattern: `file_path` of a camera, relative to the file.

    Raises:
        StudioError: a camera has skew or the rational distortion model, which the format cannot say.
    """
    frames = []
    for camera in rig:
        if np.any(camera.distortion[5:]):
            raise StudioError(
                f"Camera '{camera.name}': transforms.json holds k1 k2 p1 p2 k3 only, this camera has "
                f"{camera.distortion.size} coefficients; undistort first."
            )
        if abs(camera.K[0, 1]) > 1e-9:
            raise StudioError(f"Camera '{camera.name}': transforms.json has no place for the skew {camera.K[0, 1]:g}.")
        lens = dict(zip(("k1", "k2", "p1", "p2", "k3"), camera.distortion[:5].tolist(), strict=False))
        frames.append(
            {
                "file_path": image_pattern.format(camera=camera.name),
                "w": camera.width,
                "h": camera.height,
                "fl_x": camera.fx,
                "fl_y": camera.fy,
                "cx": camera.cx,
                "cy": camera.cy,
                **lens,
                "transform_matrix": (rigid_inverse(camera.world_to_camera) @ _FLIP).tolist(),
            }
        )
    write_atomic(path, (json.dumps({"camera_model": "OPENCV", "frames": frames}, indent=1) + "\n").encode())
