"""A camera path for a page: the player flies it once when the stream is ready, until the viewer's first input."""

from __future__ import annotations

import json
from pathlib import Path

from studio.errors import StudioError
from studio.formats.camera_path import FORMAT, VERSION, CameraPath, read_path_keys

SECONDS = 8.0
"""Duration of a path through the cameras of a rig file, which has no times."""

MAX_KEYS = 1000
"""As many as the player reads."""


def read_intro(path: Path) -> str:
    """The text that a page holds of a camera path: times, sizes and poses, without names, frames and distortion.

    Args:
        path: a camera path file (`studio.formats.camera_path`) or a rig file.

    Raises:
        StudioError: the file is missing or no camera path (`camera_path.*`), or has more than `MAX_KEYS` keys
            (`camera_path.too_many_keys`).
    """
    keys = read_path_keys(path, SECONDS)
    if len(keys) > MAX_KEYS:
        raise StudioError(
            "camera_path.too_many_keys",
            f"the camera path has {len(keys)} keys; an intro has at most {MAX_KEYS}",
            file=path,
            value=len(keys),
            fix="Remove some of the keys.",
            expected=MAX_KEYS,
        )
    first = keys[0].camera
    CameraPath(keys, first.width, first.height)  # raises what is wrong with the times and the sizes
    entries = []
    for key in keys:
        camera = key.camera.undistorted()
        entries.append(
            {
                "time": round(key.time - keys[0].time, 4),
                "camera": {
                    "width": camera.width,
                    "height": camera.height,
                    "K": camera.K.round(3).tolist(),
                    "world_to_camera": camera.world_to_camera.round(6).tolist(),
                },
            }
        )
    return json.dumps({"format": FORMAT, "version": VERSION, "keys": entries}, separators=(",", ":"))
