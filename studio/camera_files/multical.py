"""calibration.json of multical: `cameras` by name, and `camera_poses`, of which `b_to_a` maps points of a to b.

The pixel origin is OpenCV's, the center of the first pixel.
"""

import numpy as np

from v3studio.studio.camera_files.common import json_object
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import keyed_rig, pose_of
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import StudioError
from v3studio.studio.validation import missing_key


def matches(file: CameraFile) -> bool:
    """Return whether a file has this form."""
    content = file.json_object
    return isinstance(content.get("cameras"), dict) and bool({"camera_poses", "extrinsics"} & content.keys())


def read(file: CameraFile) -> Rig:
    """Read the cameras; those that no chain of poses connects to the world are left out."""
    cameras = file.json["cameras"]
    poses = file.json.get("camera_poses", file.json.get("extrinsics"))
    if not isinstance(poses, dict):
        raise missing_key("camera_poses", next(iter(cameras), "?"))
    in_world: dict[str, np.ndarray] = {}
    relative: dict[str, tuple[str, np.ndarray]] = {}
    for key, entry in poses.items():
        pose = pose_of(json_object(entry), "R", "T", key)
        name, _, base = ("", "", "") if key in cameras else key.rpartition("_to_")
        base = str(entry.get("parent") or base)
        if base and base not in cameras:
            problem = f"the pose '{key}' is relative to '{base}', which is not one of the cameras"
            fix = "Export the cameras again."
            raise StudioError("camera.unknown", problem, value=base, fix=fix, camera=name or key)
        if base:
            relative[name or key] = (base, pose)
        else:
            in_world[key] = pose
    for _ in relative:  # each pass places the cameras whose base is placed
        for name, (base, pose) in relative.items():
            if base in in_world:
                in_world[name] = pose @ in_world[base]
    entries = []
    for name, entry in cameras.items():
        placed = {"world_to_camera": in_world[name].tolist()} if name in in_world else {}
        entries.append((name, {**json_object(entry), **placed}))
    return keyed_rig(file.path.parent, entries)
