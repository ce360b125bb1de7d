"""calibrated_cameras_data.yml of MC-Calib, in OpenCV's FileStorage format.

`camera_<number>` has `camera_pose_matrix`, camera to world. Pixel coordinates are OpenCV's: the center of the first
pixel is (0, 0).
"""

from collections import defaultdict
from dataclasses import replace
from typing import Any

from v3studio.studio.camera_files.common import no_cameras
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import KeyedForm, keyed_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.counts import cameras_listed
from v3studio.studio.json_types import JsonObject


def matches(file: CameraFile) -> bool:
    """Return whether a file has this form."""
    return "nb_camera" in file.storage


def read(file: CameraFile) -> Rig:
    """Read the cameras. Those of different groups have no common world, so the largest group is used."""
    groups: dict[Any, list[tuple[str, JsonObject]]] = defaultdict(list)
    for key, entry in file.storage.items():
        if key.startswith("camera_") and isinstance(entry, dict):
            groups[entry.get("camera_group")].append((key, _usual_keys(entry)))
    if not groups:
        raise no_cameras("no cameras in the file (camera_0, camera_1, ...)")
    used = max(groups.values(), key=len)
    others = [name for group in groups.values() if group is not used for name, _ in group]
    rig = keyed_rig(file.path.parent, used, KeyedForm(harmless=("camera_group",)))
    note = f"Left out, since MC-Calib connects only the others: {cameras_listed(others)}."
    return replace(rig, notes=(*rig.notes, note), left_out=(*rig.left_out, *others)) if others else rig


def _usual_keys(entry: JsonObject) -> JsonObject:
    """The values of a camera under keys that `keyed_rig` knows."""
    names = {"camera_pose_matrix": "camera_to_world"}
    renamed = {names.get(key, key): value for key, value in entry.items()}
    lens = renamed.get("distortion_type")
    return renamed | ({"distortion_type": {0: "brown", 1: "fisheye"}.get(lens, lens)} if lens is not None else {})
