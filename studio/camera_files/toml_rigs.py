"""TOML files of Pose2Sim, Anipose and FreeMoCap, and of Caliscope.

Pose2Sim (Calib_*.toml): one table per camera with `name`, `size`, `matrix`, `distortions` (OpenCV order), `rotation`
(rotation vector) and `translation`, world to camera with OpenCV axes, and a table [metadata]. Caliscope
(camera_array.toml): the same in [cameras.<id>], with `cam_id` or `port`, `ignore`, and a matrix or vector `rotation`;
its older config.toml has [cam_<id>] among other tables. The pixel origin is OpenCV's, the center of the first pixel.
Cameras without a pose, or to `ignore`, are left out.
"""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from v3studio.studio.bounded_files import TextError, parse_toml
from v3studio.studio.camera_files.common import check_expressible, no_cameras, read_text, write_atomic
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import KeyedForm, is_camera, keyed_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject

_FORM = KeyedForm(harmless=("verified_resolutions",))


def read(file: CameraFile) -> Rig:
    """Read either format."""
    try:
        content = parse_toml(read_text(file.path))
    except TextError as error:
        problem = f"invalid TOML ({str(error)[:1].lower()}{str(error)[1:]})"
        fix = "Two cameras may have the same name, or the file may be truncated: export it again."
        raise StudioError("camera_file.syntax", problem, fix=fix) from None
    nested = content.get("cameras")
    tables = nested if isinstance(nested, dict) else content
    cameras = {key: table for key, table in tables.items() if is_camera(table)}
    if not cameras:
        raise no_cameras("no cameras in the file (tables with matrix, rotation, translation)")
    if all(table.get("ignore") for table in cameras.values()):
        raise no_cameras("all cameras in the file are marked with 'ignore'")
    named = [(_name(key, table, bool(nested)), table) for key, table in cameras.items()]
    rig = keyed_rig(file.path.parent, [(name, table) for name, table in named if not table.get("ignore")], _FORM)
    return replace(rig, left_out=(*rig.left_out, *(name for name, table in named if table.get("ignore"))))


def _name(key: str, table: JsonObject, nested: bool) -> str:
    # Caliscope names its videos by number
    return str(table.get("name") or (f"cam_{table.get('cam_id', table.get('port', key))}" if nested else key))


def write(rig: Rig, path: Path) -> None:
    """Write the format of Pose2Sim, or of Caliscope if the file is named camera_array*.toml."""
    nested = path.name.lstrip(".").startswith("camera_array")
    lines = []
    for number, camera in enumerate(rig):
        check_expressible(camera, "TOML", 4 if camera.fisheye else 14, fisheye=True)
        distortion = np.pad(camera.distortion, (0, max(0, 4 - camera.distortion.size)))
        lines.append(f"[cameras.{number}]" if nested else f"[{json.dumps(camera.name)}]")
        if nested:
            lines += [f"cam_id = {number}", "rotation_count = 0", "ignore = false"]
        lines += [
            f"name = {json.dumps(camera.name)}",
            f"size = [{camera.width}, {camera.height}]" if nested else f"size = [{camera.width}.0, {camera.height}.0]",
            f"matrix = {camera.cv2_K.tolist()}",
            f"distortions = {distortion[: 4 if camera.fisheye else None].tolist()}",
            f"rotation = {camera.rotation.tolist() if nested else cv2.Rodrigues(camera.rotation)[0].ravel().tolist()}",
            f"translation = {camera.translation.tolist()}",
            f"fisheye = {str(camera.fisheye).lower()}",
            "",
        ]
    if not nested:
        lines += ["[metadata]", "adjusted = false", "error = 0.0"]
    write_atomic(path, ("\n".join(lines) + "\n").encode())
