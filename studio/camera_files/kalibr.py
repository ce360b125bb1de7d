"""camchain.yaml of Kalibr: `cam0`, `cam1`, ..., each with `T_cn_cnm1`, which maps points of the camera before it to it.

`intrinsics` are fx, fy, cx, cy of a pinhole camera, whose `distortion_model` is radtan (OpenCV's) or equidistant
(OpenCV's fisheye). The pixel origin is OpenCV's, the center of the first pixel. World is the first camera.
"""

import numpy as np

from v3studio.studio.bounded_files import TextError
from v3studio.studio.camera_files.common import json_object, no_cameras, read_text
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import KeyedForm, keyed_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject
from v3studio.studio.validation import array, camera_error, missing_key
from v3studio.studio.yaml_text import parse_yaml

_FORM = KeyedForm(harmless=("cam_overlaps", "rostopic", "timeshift_cam_imu", "T_cam_imu", "T_cn_cnm1"))


def read(file: CameraFile) -> Rig:
    """Read the cameras of a chain."""
    try:
        content = parse_yaml(read_text(file.path))
    except TextError as error:
        fix = "The file may be truncated: export the cameras again."
        raise StudioError("camera_file.syntax", f"invalid YAML ({error})", fix=fix) from None
    cameras = {key: json_object(entry) for key, entry in json_object(content).items() if str(key).startswith("cam")}
    if not cameras:
        raise no_cameras("no cameras in the file (cam0, cam1, ...)")
    pose, entries = np.eye(4), []
    for number, (name, entry) in enumerate(cameras.items()):
        if number:
            if "T_cn_cnm1" not in entry:
                raise missing_key("T_cn_cnm1", name)
            pose = array(entry["T_cn_cnm1"], "T_cn_cnm1", name).reshape(4, 4) @ pose
        entries.append((name, _usual(name, entry) | {"world_to_camera": pose.tolist()}))
    return keyed_rig(file.path.parent, entries, _FORM)


def _usual(name: str, entry: JsonObject) -> JsonObject:
    """The values of a camera under keys that `keyed_rig` knows."""
    if entry.get("camera_model") != "pinhole":
        problem, value = f"the camera model {entry.get('camera_model')!r} is not supported", entry.get("camera_model")
        fix = "Calibrate with pinhole-equi or pinhole-radtan."
        raise camera_error("camera.lens_model", name, problem, value=value, fix=fix, key="camera_model")
    values = array(entry.get("intrinsics", []), "intrinsics", name)
    if values.shape != (4,):
        raise missing_key("intrinsics", name)
    lens = dict(zip(("fx", "fy", "cx", "cy"), values.tolist(), strict=True))
    return {key: value for key, value in entry.items() if key != "intrinsics"} | lens
