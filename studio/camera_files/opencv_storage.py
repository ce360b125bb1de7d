"""Calibrations in OpenCV's FileStorage format (XML or YAML).

`read_storage` gives the values of a file. `read_opencv_cameras` reads rigs that have one file per camera, such as
`{camera}/config.xml`; `rig_from_mc_calib` reads MC-Calib's file, which has them all. Keys are those of
`studio.camera_files.keyed`; pixel coordinates are OpenCV's: the center of the first pixel is (0, 0).
"""

from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.camera_files.common import no_cameras, read_text
from v3studio.studio.camera_files.keyed import KeyedForm, keyed_rig
from v3studio.studio.camera_files.nearby import size_nearby, size_within
from v3studio.studio.cameras import Rig
from v3studio.studio.capture.patterns import find_files
from v3studio.studio.counts import cameras_listed
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.json_types import JsonObject

EXTENSIONS = frozenset({".xml", ".yml", ".yaml"})


def read_storage(path: Path) -> JsonObject:
    """The values of a file: objects, lists, numbers and text; matrices are nested lists."""
    import cv2

    text = read_text(path)
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        keys = list(root.keys())
    except (cv2.error, SystemError) as error:  # OpenCV 5's bindings raise SystemError for some errors
        reason = str(error.__cause__ or error).split("error:")[-1].strip().splitlines()[0]
        problem = f"OpenCV cannot parse the file ({reason})"
        fix = "The file may be truncated: export the cameras again."
        raise StudioError("camera_file.syntax", problem, file=path, fix=fix) from None
    with naming(path):
        return {key: _value(root.getNode(key), key) for key in keys}


def _value(node: Any, key: str) -> Any:
    import cv2

    if node.isMap():
        keys = set(node.keys())
        if not {"rows", "cols", "sizes"} & keys:
            return {inner: _value(node.getNode(inner), inner) for inner in keys}
        try:
            matrix = node.mat()
        except cv2.error:
            matrix = None
        if matrix is None:
            problem, fix = f"'{key}' is not a complete matrix", "Export the cameras again."
            raise StudioError("camera.not_a_matrix", problem, fix=fix, key=key)
        return np.asarray(matrix, np.float64).tolist()
    if node.isSeq():
        return [_value(node.at(index), key) for index in range(node.size())]
    if node.isInt() or node.isReal():
        value = node.real()
        return int(value) if node.isInt() else value
    return node.string() if node.isString() else None


def read_opencv_cameras(root: Path, pattern: str) -> Rig:
    """A rig from one file per camera. `pattern`: path of the files below it, with `{camera}`."""
    matches = find_files(root, pattern, EXTENSIONS)
    if not matches:
        raise no_cameras(f"no file matches '{pattern}'", root)
    folders = {match.camera: match.path.parent for match in matches}
    form = KeyedForm(size_of=lambda name: size_within(folders[name], name) or size_nearby(root, name, name))
    return keyed_rig(root, [(match.camera, read_storage(match.path)) for match in matches], form)


def rig_from_mc_calib(folder: Path, values: JsonObject) -> Rig:
    """A rig from MC-Calib's calibrated_cameras_data.yml: `camera_<number>` with `camera_pose_matrix`, camera to world.

    Cameras of different groups have no common world, so the largest group is used.
    """
    groups: dict[Any, list[tuple[str, JsonObject]]] = defaultdict(list)
    for key, entry in values.items():
        if key.startswith("camera_") and isinstance(entry, dict):
            groups[entry.get("camera_group")].append((key, _of_mc_calib(entry)))
    if not groups:
        raise no_cameras("no cameras in the file (camera_0, camera_1, ...)")
    used = max(groups.values(), key=len)
    others = [name for group in groups.values() if group is not used for name, _ in group]
    rig = keyed_rig(folder, used, KeyedForm(harmless=("camera_group",)))
    note = f"Left out, since MC-Calib connects only the others: {cameras_listed(others)}."
    return replace(rig, notes=(*rig.notes, note), left_out=(*rig.left_out, *others)) if others else rig


def _of_mc_calib(entry: JsonObject) -> JsonObject:
    names = {"camera_pose_matrix": "camera_to_world"}
    renamed = {names.get(key, key): value for key, value in entry.items()}
    lens = renamed.get("distortion_type")
    return renamed | ({"distortion_type": {0: "brown", 1: "fisheye"}.get(lens, lens)} if lens is not None else {})
