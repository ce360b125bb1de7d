"""rig.json, the format of V3 Studio, and other JSON files with a list of cameras.

rig.json: `{"format": "v3studio-rig", "version": 1, "cameras": [Camera.to_dict(), ...]}`; and `left_out`, the names of
cameras without a pose, if there are any. cameras.json: `{"cameras": [{"name", "width", "height", "K", "R", "t",
"distortion"}, ...]}` or only the list, x ~ K (R X + t). The pixel origin is the image corner.
"""

import json
from dataclasses import replace
from pathlib import Path

from v3studio.studio.camera_files.common import json_object, no_cameras, write_atomic
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import KeyedForm, ignored_in_file, keyed_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject
from v3studio.studio.validation import missing_key

FORMAT = "v3studio-rig"
VERSION = 1
_CORNER = "Principal points are taken relative to the image corner."


def matches(file: CameraFile) -> bool:
    """Return whether a file has a list of cameras, or is one."""
    content = file.json
    if isinstance(content, list):
        return bool(content) and isinstance(content[0], dict) and {"name", "K"} <= content[0].keys()
    return isinstance(file.json_object.get("cameras"), list)


def read(file: CameraFile) -> Rig:
    """Read the cameras. Raises StudioError: a version of V3 Studio's format that is not known
    (camera_file.wrong_version)."""
    content = {"cameras": file.json} if isinstance(file.json, list) else file.json_object
    entries, notes = listed_cameras(content)
    rig = keyed_rig(file.path.parent, entries, KeyedForm(corner=True))
    if content.get("format") != FORMAT:
        return replace(rig, notes=(*rig.notes, *notes, _CORNER))
    left_out = content.get("left_out", [])
    if not isinstance(left_out, list):
        raise StudioError(
            "camera_file.not_a_list", "'left_out' must be a list of names", value=left_out,
            fix="Calibrate again.",
        )  # fmt: skip
    return replace(rig, left_out=(*rig.left_out, *map(str, left_out)))


def listed_cameras(content: JsonObject) -> tuple[list[tuple[str, JsonObject]], tuple[str, ...]]:
    """Name and values of each entry of `cameras`, and notes on the keys beside it. Raises StudioError as `read`."""
    if content.get("format") == FORMAT and content.get("version", VERSION) != VERSION:
        problem = f"the format version is {content['version']}, expected {VERSION}"
        fix = "Update V3 Studio."
        raise StudioError("camera_file.wrong_version", problem, value=content["version"], fix=fix, expected=VERSION)
    if not content["cameras"]:
        raise no_cameras("the list 'cameras' is empty")
    entries = []
    notes = ignored_in_file(content, ("cameras", "format", "version", "left_out", "calibDataSource"))
    for index, entry in enumerate(map(json_object, content["cameras"])):
        if "name" not in entry:
            raise missing_key("name", f"number {index}")
        entries.append((str(entry["name"]), entry))
    return entries, notes


def write(rig: Rig, path: Path) -> None:
    """Write rig.json atomically, with full precision. Raises StudioError (camera_file.unwritable)."""
    content = {"format": FORMAT, "version": VERSION, "cameras": [camera.to_dict() for camera in rig]}
    content |= {"left_out": list(rig.left_out)} if rig.left_out else {}
    write_atomic(path, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())
