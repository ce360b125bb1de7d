"""TOML files of Pose2Sim, Anipose and FreeMoCap, and of Caliscope.

Pose2Sim (Calib_*.toml): a table a camera with `name`, `size`, `matrix`, `distortions` (OpenCV's order), `rotation`
(rotation vector) and `translation`; world to camera, OpenCV's axes; beside them [metadata]. Caliscope
(camera_array.toml): the same below [cameras.<id>], with `cam_id` or `port`, `rotation` a matrix or a vector, and
`ignore`; its older config.toml has [cam_<id>] tables among others. Pixel origin: OpenCV's, the first pixel's center.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from studio.camera_files.common import naming, read_text, write_atomic
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.validation import array, check_finite


def read_toml(path: Path) -> Rig:
    """Read either form.

    Raises:
        StudioError: no whole TOML, no cameras in it, a key is missing, a value is unusable, a fisheye lens.
    """
    try:
        values = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise StudioError(
            f"{path}: not valid TOML ({str(error)[:1].lower()}{str(error)[1:]}); two cameras may have one name, or the "
            "file may be cut short: export it again."
        ) from None
    with naming(path):
        nested = values.get("cameras")
        tables = nested if isinstance(nested, dict) else values
        found = {
            key: table
            for key, table in tables.items()
            if isinstance(table, dict) and {"matrix", "rotation", "translation", "distortions"} & set(table)
        }
        if not found:
            raise StudioError("has no camera (tables with matrix, rotation, translation); export it again.")
        used = {key: table for key, table in found.items() if not table.get("ignore")}
        return Rig(tuple(_camera(key, table, bool(nested)) for key, table in used.items()))


def _camera(key: str, table: dict[str, Any], nested: bool) -> Camera:
    import cv2

    # Caliscope names its videos after the number
    name = str(table.get("name") or (f"cam_{table.get('cam_id', table.get('port', key))}" if nested else key))
    who = f"Camera '{name}'"
    if table.get("fisheye"):
        raise StudioError(f"{who}: fisheye lenses are not supported; undistort the images to a pinhole camera first.")
    K = _array(table, "matrix", who, ((3, 3),)).copy()
    K[:2, 2] += 0.5
    rotation = _array(table, "rotation", who, ((3,), (3, 3), (3, 1), (1, 3)))
    pose = np.eye(4)
    pose[:3, :3] = rotation if rotation.shape == (3, 3) else cv2.Rodrigues(rotation.reshape(3))[0]
    pose[:3, 3] = _array(table, "translation", who, ((3,), (3, 1), (1, 3))).ravel()
    width, height = _array(table, "size", who, ((2,),))
    lens = _array(table, "distortions", who).ravel() if "distortions" in table else np.zeros(0)
    return Camera(name, round(width), round(height), K, pose, lens if lens.any() else np.zeros(0))


def _array(table: dict[str, Any], key: str, who: str, shapes: tuple[tuple[int, ...], ...] = ()) -> np.ndarray:
    if key not in table:
        raise StudioError(f"{who}: the key '{key}' is missing.")
    value = array(table[key], key, who)
    if shapes and value.shape not in shapes:
        wanted = " or ".join("x".join(map(str, shape)) for shape in shapes)
        raise StudioError(f"{who}: '{key}' has shape {value.shape}; {wanted} is needed.")
    check_finite(value, key, who)
    return value


def write_toml(rig: Rig, path: Path) -> None:
    """Write Pose2Sim's form, or Caliscope's where the file is named camera_array.toml.

    Raises:
        StudioError: an unwritable place.
    """
    import json

    import cv2

    nested = path.name.lstrip(".").startswith("camera_array")
    lines = []
    for number, camera in enumerate(rig):
        lens = np.zeros(max(4, camera.distortion.size))
        lens[: camera.distortion.size] = camera.distortion
        lines.append(f"[cameras.{number}]" if nested else f"[{json.dumps(camera.name)}]")
        if nested:
            lines += [f"cam_id = {number}", "rotation_count = 0", "ignore = false"]
        lines += [
            f"name = {json.dumps(camera.name)}",
            f"size = [{camera.width}, {camera.height}]" if nested else f"size = [{camera.width}.0, {camera.height}.0]",
            f"matrix = {camera.cv2_K.tolist()}",
            f"distortions = {lens.tolist()}",
            f"rotation = {camera.rotation.tolist() if nested else cv2.Rodrigues(camera.rotation)[0].ravel().tolist()}",
            f"translation = {camera.translation.tolist()}",
            "fisheye = false",
            "",
        ]
    if not nested:
        lines += ["[metadata]", "adjusted = false", "error = 0.0"]
    write_atomic(path, ("\n".join(lines) + "\n").encode())
