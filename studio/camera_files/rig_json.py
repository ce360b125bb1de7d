"""rig.json, the format of V3 Studio: `{"format": "v3studio-rig", "version": 1, "cameras": [Camera.to_dict(), ...]}`;
and `left_out`, the names of cameras without a pose, if there are any.

It is read as other JSON files are (`studio.camera_files.json_rigs`), after a check of its version. The pixel origin is
the image corner.
"""

import json
from pathlib import Path

from v3studio.studio.camera_files.common import write_atomic
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject

FORMAT = "v3studio-rig"
VERSION = 1


def check_format(values: JsonObject) -> None:
    """Check the format and version of a JSON object, if it has them."""
    if values.get("format", FORMAT) != FORMAT:
        problem = f"the format is {values['format']!r}, expected '{FORMAT}'"
        fix = "Specify a camera file."
        raise StudioError("camera_file.wrong_format", problem, value=values["format"], fix=fix, expected=FORMAT)
    if values.get("version", VERSION) != VERSION:
        problem = f"the format version is {values['version']}, expected {VERSION}"
        fix = "Update V3 Studio."
        raise StudioError("camera_file.wrong_version", problem, value=values["version"], fix=fix, expected=VERSION)


def write_rig_json(rig: Rig, path: Path) -> None:
    """Write rig.json atomically, with full precision. Raises StudioError (camera_file.unwritable)."""
    values = {"format": FORMAT, "version": VERSION, "cameras": [camera.to_dict() for camera in rig]}
    values |= {"left_out": list(rig.left_out)} if rig.left_out else {}
    write_atomic(path, (json.dumps(values, indent=1, allow_nan=False) + "\n").encode())
