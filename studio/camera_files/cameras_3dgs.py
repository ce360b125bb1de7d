"""cameras.json of 3DGS: a list with `img_name`, `position` (center), `rotation` (camera to world), `fx`, `fy`.

It has no principal points, for which 3DGS takes the image centers, and no lens distortion.
"""

from dataclasses import replace

from v3studio.studio.camera_files.common import camera_names, json_object
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import KeyedForm, keyed_rig, pose_of
from v3studio.studio.cameras import Rig


def matches(file: CameraFile) -> bool:
    """Return whether a file has this form; an entry that is no object is refused by `read`."""
    if not isinstance(file.json, list) or not file.json:
        return False
    other = next((entry for entry in file.json if not isinstance(entry, dict) or "img_name" not in entry), None)
    return not isinstance(other, dict)


def read(file: CameraFile) -> Rig:
    """Read the cameras; values that 3DGS does not write are known or rejected as in other files."""
    notes = ["3DGS's cameras.json has no lens distortion: the images are taken as undistorted."]
    entries = [json_object(entry) for entry in file.json]
    converted = []
    for name, entry in zip(camera_names([str(entry["img_name"]) for entry in entries]), entries, strict=True):
        pose = pose_of(entry, "rotation", "position", name)
        rest = {key: value for key, value in entry.items() if key not in ("position", "rotation", "img_name")}
        converted.append((name, {**rest, "camera_to_world": pose.tolist()}))
    if not any("cx" in entry for entry in entries):
        notes.append("3DGS's cameras.json has no principal points: they are taken to be the image centers.")
    rig = keyed_rig(file.path.parent, converted, KeyedForm(corner=True, centered=True))
    return replace(rig, notes=(*notes, *rig.notes[1:]))
