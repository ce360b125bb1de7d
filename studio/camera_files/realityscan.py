"""The export "Internal/External camera parameters" (CSV) of RealityScan (RealityCapture).

One row per image: #name, x, y, alt (center), heading, pitch, roll in degrees, f in millimeters for a longer image side
of 36 mm, px, py (principal point relative to the image center, as fractions of the longer side), k1 to k4. Camera to
world is Rz(-heading) Rx(pitch) Ry(roll) with x right, y up, z back, as in the importers of other programs. The file
does not contain image sizes, so the images must be next to it; rows without an image are left out. The tangential terms
t1 and t2, whose order is not documented, must be 0 (the default lens model does not have them).
"""

import numpy as np

from v3studio.studio.camera_files.common import camera_names, read_csv, rigid_inverse
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import NO_DISTORTION
from v3studio.studio.camera_files.common.lens_fit import brown
from v3studio.studio.camera_files.common.nearby import size_nearby
from v3studio.studio.cameras import OPENGL_AXES, Camera, Rig, focal_length_error
from v3studio.studio.counts import cameras_listed
from v3studio.studio.errors import StudioError
from v3studio.studio.validation import camera_error, number

_COLUMNS = ("name", "x", "y", "alt", "heading", "pitch", "roll", "f")
_LENS = ("px", "py", "k1", "k2", "k3", "k4", "t1", "t2")


def matches(file: CameraFile) -> bool:
    """Return whether a file is CSV; `CAMERA_FORMATS` tries the CSV of ActorsHQ before."""
    return file.kind == "csv"


def read(file: CameraFile) -> Rig:
    """Read the CSV; image sizes come from the images next to it."""
    rows = read_csv(file.path, _COLUMNS, _LENS)
    cameras, missing = [], []
    for name, row in zip(camera_names([row["name"] for row in rows]), rows, strict=True):
        try:
            size = size_nearby(file.path.parent, row["name"], name)
        except StudioError as error:
            if error.code != "camera.size_unknown":
                raise
            missing.append((name, error))
            continue
        cameras.append(_camera(name, row, size))
    if not cameras:
        raise missing[0][1]
    left_out = cameras_listed([name for name, _ in missing])
    notes = (f"Left out, since there are no images to give the size of {left_out}.",) if missing else ()
    bent = any(row.get(key, "").strip("+-0.") for row in rows for key in _LENS[2:])
    return Rig(tuple(cameras), notes if bent else (NO_DISTORTION, *notes))


def _camera(name: str, row: dict[str, str], size: tuple[int, int]) -> Camera:
    from scipy.spatial.transform import Rotation

    value = {key: number(row, key, name) for key in _COLUMNS[1:]}
    value |= {key: number(row, key, name, 0.0) for key in _LENS}
    if value["t1"] or value["t2"]:
        problem = f"tangential distortion is not supported, but t1 and t2 are {value['t1']:g} and {value['t2']:g}"
        fix = "Export with the lens model Brown3 or Brown4."
        raise camera_error("camera.lens_model", name, problem, value=[value["t1"], value["t2"]], fix=fix)
    width, height = size
    side = max(width, height)
    focal = value["f"] * side / 36.0
    if focal <= 0:
        raise focal_length_error(name, value["f"])
    middle = width / 2 + value["px"] * side, height / 2 + value["py"] * side
    K = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]])
    turn = Rotation.from_euler("ZXY", [-value["heading"], value["pitch"], value["roll"]], degrees=True).as_matrix()
    pose = np.column_stack([turn @ OPENGL_AXES[:3, :3], [value["x"], value["y"], value["alt"]]])
    distortion = brown([value[f"k{i}"] for i in (1, 2, 3, 4)], (0.0, 0.0), K, size, name)
    return Camera(name, width, height, K, rigid_inverse(pose), distortion)
