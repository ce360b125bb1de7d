"""Cameras in the JSON files of other programs that name their values.

- cameras.json: `{"cameras": [{"name", "width", "height", "K", "R", "t", "distortion"}, ...]}`, x ~ K (R X + t), with
  the pixel origin at the image corner.
- CMU Panoptic's calibration_*.json: the same with `resolution` and `distCoef`, in centimeters.
- multical's calibration.json: `cameras` by name, and `camera_poses`, of which `b_to_a` maps points of a to b.
- calibration.json of THuman4.0 and AvatarReX, and others: one entry per camera with K, R, T, `distCoeff`, `imgSize`.
- cameras.json of 3DGS: a list with `img_name`, `position` (center), `rotation` (camera to world), `fx`, `fy`; without
  a principal point, for which 3DGS takes the image center.

Panoptic, multical and THuman4.0 have OpenCV's pixel origin, the center of the first pixel.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.camera_files.common import camera_names, no_cameras, wrong_shape
from v3studio.studio.camera_files.keyed import KeyedForm, ignored_in_file, is_camera, keyed_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject
from v3studio.studio.validation import array, check_finite, missing_key

_PANOPTIC = KeyedForm(unit=0.01, harmless=("calibDataSource",))
_CORNER = "Principal points are taken relative to the image corner."


def rig_from_json(folder: Path, values: Any) -> Rig | None:
    """A rig from the JSON value in the file; None if it is in none of these forms."""
    if isinstance(values, list):
        return _of_3dgs(folder, values) if values and all("img_name" in _object(entry) for entry in values) else None
    cameras = values.get("cameras")
    if isinstance(cameras, list):
        return _of_list(folder, values, cameras)
    if isinstance(cameras, dict):
        return _of_multical(folder, values, cameras)
    if values and any(map(is_camera, values.values())) and all(isinstance(entry, dict) for entry in values.values()):
        return keyed_rig(folder, list(values.items()))
    return None


def _object(entry: Any) -> JsonObject:
    if not isinstance(entry, dict):
        problem = f"an entry of the list of cameras is {type(entry).__name__}, not an object"
        raise StudioError("camera_file.not_an_object", problem, value=entry, fix="Export the cameras again.")
    return entry


def _of_list(folder: Path, values: JsonObject, cameras: list[Any]) -> Rig:
    if not cameras:
        raise no_cameras("the list 'cameras' is empty")
    entries = []
    ignored = ignored_in_file(values, ("cameras", "format", "version", "left_out", "calibDataSource"))
    for index, entry in enumerate(_object(camera) for camera in cameras):
        if "name" not in entry:
            raise missing_key("name", f"number {index}")
        entries.append((str(entry["name"]), entry))
    if "calibDataSource" in values or all("panel" in entry and "node" in entry for _, entry in entries):
        rig = keyed_rig(folder, entries, _PANOPTIC)
        return replace(rig, notes=(*rig.notes, *ignored, "CMU Panoptic: centimeters are converted to meters."))
    rig = keyed_rig(folder, entries, KeyedForm(corner=True))
    if "format" not in values:
        return replace(rig, notes=(*rig.notes, *ignored, _CORNER))
    left_out = values.get("left_out", [])
    if not isinstance(left_out, list):
        raise StudioError(
            "camera_file.not_a_list", "'left_out' must be a list of names", value=left_out,
            fix="Calibrate again.",
        )  # fmt: skip
    return replace(rig, left_out=(*rig.left_out, *map(str, left_out)))


def _of_multical(folder: Path, values: JsonObject, cameras: JsonObject) -> Rig:
    poses = values.get("camera_poses", values.get("extrinsics"))
    if not isinstance(poses, dict):
        raise missing_key("camera_poses", next(iter(cameras), "?"))
    found: dict[str, np.ndarray] = {}
    relative: dict[str, tuple[str, np.ndarray]] = {}
    for key, entry in poses.items():
        pose = _pose(_object(entry), "R", "T", key)
        name, _, base = ("", "", "") if key in cameras else key.rpartition("_to_")
        base = str(entry.get("parent") or base)
        if base and base not in cameras:
            problem = f"the pose '{key}' is relative to '{base}', which is not one of the cameras"
            fix = "Export the cameras again."
            raise StudioError("camera.unknown", problem, value=base, fix=fix, camera=name or key)
        if base:
            relative[name or key] = (base, pose)
        else:
            found[key] = pose
    for _ in relative:  # each pass places the cameras whose base is placed
        for name, (base, pose) in relative.items():
            if base in found:
                found[name] = pose @ found[base]
    entries = []
    for name, entry in cameras.items():
        placed = {"world_to_camera": found[name].tolist()} if name in found else {}
        entries.append((name, {**_object(entry), **placed}))
    return keyed_rig(folder, entries)


def _pose(entry: JsonObject, rotation: str, translation: str, camera: str) -> np.ndarray:
    """(4, 4) from the matrix and the vector under these keys."""
    pose = np.eye(4)
    for key, place in ((rotation, pose[:3, :3]), (translation, pose[:3, 3])):
        if key not in entry:
            raise missing_key(key, camera)
        value = array(entry[key], key, camera)
        if value.size != place.size:
            raise wrong_shape(key, camera, value.shape, (place.shape,))
        check_finite(value, key, camera)
        place[:] = value.reshape(place.shape)
    return pose


def _of_3dgs(folder: Path, entries: list[JsonObject]) -> Rig:
    """3DGS's own list; values that it does not write are known or rejected as in other files."""
    notes = ["3DGS's cameras.json has no lens distortion: the images are taken as undistorted."]
    converted = []
    for name, entry in zip(camera_names([str(entry["img_name"]) for entry in entries]), entries, strict=True):
        pose = _pose(entry, "rotation", "position", name)
        rest = {key: value for key, value in entry.items() if key not in ("position", "rotation", "img_name")}
        converted.append((name, {**rest, "camera_to_world": pose.tolist()}))
    if not any("cx" in entry for entry in entries):
        notes.append("3DGS's cameras.json has no principal points: they are taken to be the image centers.")
    rig = keyed_rig(folder, converted, KeyedForm(corner=True, centered=True))
    return replace(rig, notes=(*notes, *rig.notes[1:]))
