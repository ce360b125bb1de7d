"""rig.json, the format of V3 Studio, and plain cameras.json files with K, R, t.

rig.json: `{"format": "v3studio-rig", "version": 1, "cameras": [Camera.to_dict(), ...]}`.

cameras.json: `{"cameras": [{"name", "width", "height", "K" (3x3), "R" (3x3), "t" (3), "distortion" (optional,
OpenCV order)}, ...]}`, x ~ K (R X + t), OpenCV axes. Both have the pixel origin at the image corner.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from studio.camera_files.common import matrix, naming, no_cameras, read_json, write_atomic, wrong_shape
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.validation import array, check_finite, missing_key, whole

FORMAT = "v3studio-rig"
VERSION = 1


def rig_from_values(path: Path, values: dict[str, Any]) -> Rig:
    """A rig from the JSON object in the file.

    Raises:
        StudioError: the format or version is not supported or there are no cameras (camera_file.*), or a camera is
            invalid (camera.*).
    """
    with naming(path):
        if values.get("format", FORMAT) != FORMAT:
            raise StudioError(
                "camera_file.wrong_format",
                f"the format is {values['format']!r}, expected '{FORMAT}'",
                value=values["format"],
                fix="Specify a camera file.",
                expected=FORMAT,
            )
        if values.get("version", VERSION) != VERSION:
            raise StudioError(
                "camera_file.wrong_version",
                f"the format version is {values['version']}, expected {VERSION}",
                value=values["version"],
                fix="Update V3 Studio.",
                expected=VERSION,
            )
        entries = values.get("cameras")
        if not isinstance(entries, list) or not entries:
            raise no_cameras("the list 'cameras' is missing or empty")
        return Rig(tuple(_camera(entry, index) for index, entry in enumerate(entries)))


def _camera(entry: Any, index: int) -> Camera:
    if not isinstance(entry, dict):
        raise StudioError(
            "camera_file.not_an_object",
            f"entry {index} of 'cameras' is not an object",
            value=entry,
            fix="Export the cameras again.",
        )
    if "name" not in entry:
        raise missing_key("name", f"number {index}")
    name = str(entry["name"])
    if "world_to_camera" in entry:
        return Camera.from_dict(entry)
    for key in ("K", "R", "t"):
        if key not in entry:
            raise missing_key(key, name)
    pose = np.eye(4)
    pose[:3, :3] = matrix(entry["R"], (3,), 3, "R", name)
    translation = array(entry["t"], "t", name)
    if translation.size != 3:
        raise wrong_shape("t", name, translation.shape, ((3,),))
    pose[:3, 3] = translation.reshape(3)
    distortion = array(entry.get("distortion") or [], "distortion", name).reshape(-1)
    check_finite(pose[:3, 3], "t", name)
    check_finite(distortion, "distortion", name)
    return Camera(
        name=name,
        width=whole(entry, "width", name),
        height=whole(entry, "height", name),
        K=matrix(entry["K"], (3,), 3, "K", name),
        world_to_camera=pose,
        distortion=distortion,
    )


def read_rig_json(path: Path) -> Rig:
    """Read rig.json or cameras.json. Raises StudioError as `rig_from_values`."""
    return rig_from_values(path, read_json(path))


def write_rig_json(rig: Rig, path: Path) -> None:
    """Write rig.json atomically, with full precision. Raises StudioError (camera_file.unwritable)."""
    values = {"format": FORMAT, "version": VERSION, "cameras": [camera.to_dict() for camera in rig]}
    write_atomic(path, (json.dumps(values, indent=1, allow_nan=False) + "\n").encode())
