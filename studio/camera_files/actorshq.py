"""calibration.csv of ActorsHQ (HumanRF).

One row per camera: name, w, h, rx ry rz (rotation vector, camera to world), tx ty tz (center), fx fy px py as fractions
of the width and height. OpenCV axes. The principal point is relative to the image corner, as in COLMAP, from which the
data set's exporter copies it unchanged. The images are undistorted.
"""

from pathlib import Path

import cv2
import numpy as np

from v3studio.studio.camera_files.common import check_expressible, read_csv, rigid_inverse, write_atomic
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import NO_DISTORTION
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.validation import camera_error, number

COLUMNS = ("name", "w", "h", "rx", "ry", "rz", "tx", "ty", "tz", "fx", "fy", "px", "py")


def matches(file: CameraFile) -> bool:
    """Return whether a file has most of the columns: the error names those that are missing."""
    return len(file.columns & set(COLUMNS)) > 9


def read(file: CameraFile) -> Rig:
    """Read the cameras."""
    return Rig(tuple(_camera(row) for row in read_csv(file.path, COLUMNS)), (NO_DISTORTION,))


def _camera(row: dict[str, str]) -> Camera:
    value = {key: number(row, key, row["name"]) for key in COLUMNS[1:]}
    width, height = round(value["w"]), round(value["h"])
    turn, center = (np.array([value[key + axis] for axis in "xyz"]) for key in "rt")
    pose = np.column_stack([cv2.Rodrigues(turn)[0], center])
    fx, fy, cx, cy = (value[key] * (width if "x" in key else height) for key in COLUMNS[-4:])
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return Camera(row["name"], width, height, K, rigid_inverse(pose))


def write(rig: Rig, path: Path) -> None:
    """Write the cameras, atomically."""
    lines = [",".join(COLUMNS)]
    for camera in rig:
        check_expressible(camera, "calibration.csv", 0)
        if "," in camera.name:
            problem = "names in calibration.csv cannot contain a comma"
            raise camera_error("camera_file.not_expressible", camera.name, problem, fix="Rename the camera.")
        vector = cv2.Rodrigues(camera.rotation.T)[0].ravel()
        w, h = camera.width, camera.height
        numbers = [*vector, *camera.center, camera.fx / w, camera.fy / h, camera.cx / w, camera.cy / h]
        lines.append(",".join([camera.name, str(w), str(h), *(repr(float(value)) for value in numbers)]))
    write_atomic(path, ("\n".join(lines) + "\n").encode())
