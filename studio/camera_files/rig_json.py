"""rig.json, our own form, and plain cameras.json files with K, R, t.

rig.json: `{"format": "v3studio-rig", "version": 1, "cameras": [Camera.to_dict(), ...]}`.

cameras.json: `{"cameras": [{"name", "width", "height", "K" (3x3), "R" (3x3), "t" (3), "distortion" (optional,
OpenCV order)}, ...]}`, x ~ K (R X + t), OpenCV axes. Both have the pixel origin at the image corner.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from studio.camera_files.common import matrix, naming, read_json, write_atomic
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.validation import array, check_finite, whole

FORMAT = "v3studio-rig"
VERSION = 1


def rig_from_values(path: Path, values: dict[str, Any]) -> Rig:
    """A rig from the object that the file holds.

    Raises:
        StudioError: a key is missing, a value is unusable, two cameras have one name, another version.
    """
    with naming(path):
        if values.get("format", FORMAT) != FORMAT:
            raise StudioError(f"its format is {values['format']!r}; '{FORMAT}' is expected.")
        if values.get("version", VERSION) != VERSION:
            raise StudioError(
                f"it is version {values['version']}, this program reads version {VERSION}; update V3 Studio."
            )
        entries = values.get("cameras")
        if not isinstance(entries, list) or not entries:
            raise StudioError("the list 'cameras' is missing or empty; export the cameras again.")
        return Rig(tuple(_camera(entry, index) for index, entry in enumerate(entries)))


def _camera(entry: Any, index: int) -> Camera:
    if not isinstance(entry, dict):
        raise StudioError(f"entry {index} of 'cameras' is not an object.")
    if "name" not in entry:
        raise StudioError(f"entry {index} of 'cameras' has no 'name'.")
    who = f"Camera '{entry['name']}'"
    if "world_to_camera" in entry:
        return Camera.from_dict(entry)
    for key in ("K", "R", "t"):
        if key not in entry:
            raise StudioError(f"{who}: the key '{key}' is missing.")
    pose = np.eye(4)
    pose[:3, :3] = matrix(entry["R"], (3,), 3, "R", who)
    place = array(entry["t"], "t", who)
    if place.size != 3:
        raise StudioError(f"{who}: 't' has {place.size} numbers; three are needed.")
    pose[:3, 3] = place.reshape(3)
    distortion = array(entry.get("distortion") or [], "distortion", who).reshape(-1)
    check_finite(pose[:3, 3], "t", who)
    check_finite(distortion, "distortion", who)
    return Camera(
        name=str(entry["name"]),
        width=whole(entry, "width", who),
        height=whole(entry, "height", who),
        K=matrix(entry["K"], (3,), 3, "K", who),
        world_to_camera=pose,
        distortion=distortion,
    )


def read_rig_json(path: Path) -> Rig:
    """Read rig.json or cameras.json. Raises StudioError."""
    return rig_from_values(path, read_json(path))


def write_rig_json(rig: Rig, path: Path) -> None:
    """Write rig.json, atomically; numbers keep their full precision."""
    values = {"format": FORMAT, "version": VERSION, "cameras": [camera.to_dict() for camera in rig]}
    write_atomic(path, (json.dumps(values, indent=1, allow_nan=False) + "\n").encode())
