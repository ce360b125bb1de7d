"""Qualisys Track Manager calibrations (.qca.txt, XML).

As found in files that the program and Pose2Sim write:
- `transform` x y z is the camera's center in millimeters; r11..r33 is a world-to-camera rotation whose axes are
  x right, y up, z back, so y and z are turned over for ours.
- `intrinsic` counts pixels in 1/64: focal lengths and principal point are divided by 64. The principal point is
  relative to the sensor, of which `fov_video` (corners inclusive) is the part that was recorded, and has its origin at
  the center of the first pixel, as in OpenCV. Distortion is OpenCV's, without unit. (Pose2Sim divides distortion by
  64 as well; calibrating the lens from board pictures shows that the plain numbers are meant.)
- Cameras that only track markers are left out where the file has video cameras.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from studio.camera_files.common import naming
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.validation import number

_SUBPIXELS = 64.0
_FLIP = np.diag([1.0, -1.0, -1.0])


def rig_from_qualisys(path: Path, root: ElementTree.Element) -> Rig:
    """A rig from the file's root element <calibration>; positions become meters.

    Raises:
        StudioError: an element or number is missing or unusable.
    """
    with naming(path):
        entries = [entry for entry in root.findall("cameras/camera") if entry.get("active", "1") != "0"]
        video = [entry for entry in entries if _records_video(entry)]
        if not entries:
            raise StudioError("holds no active camera (calibration/cameras/camera); export the calibration again.")
        return Rig(tuple(_camera(entry, index) for index, entry in enumerate(video or entries)))


def _records_video(entry: ElementTree.Element) -> bool:
    model = entry.get("model", "none").lower()
    return "video" in model or model == "none"


def _camera(entry: ElementTree.Element, index: int) -> Camera:
    name = entry.get("serial")
    if not name:
        raise StudioError(f"camera {index + 1} has no 'serial'.")
    who = f"Camera '{name}'"

    def part(tag: str) -> dict[str, str]:
        found = entry.find(tag)
        if found is None:
            raise StudioError(f"{who}: the element <{tag}> is missing.")
        return dict(found.attrib)

    window, pose, lens = part("fov_video"), part("transform"), part("intrinsic")
    left, top = number(window, "left", who), number(window, "top", who)
    width = round(number(window, "right", who) - left) + 1
    height = round(number(window, "bottom", who) - top) + 1
    K = np.eye(3)
    K[0, 0], K[1, 1] = (number(lens, key, who) / _SUBPIXELS for key in ("focalLengthU", "focalLengthV"))
    K[0, 1] = number(lens, "skew", who, 0.0) / _SUBPIXELS
    K[0, 2] = number(lens, "centerPointU", who) / _SUBPIXELS - left + 0.5
    K[1, 2] = number(lens, "centerPointV", who) / _SUBPIXELS - top + 0.5
    distortion = np.array(
        [
            number(lens, key, who, 0.0)
            for key in (
                "radialDistortion1",
                "radialDistortion2",
                "tangentalDistortion1",  # the format's own spelling
                "tangentalDistortion2",
                "radialDistortion3",
            )
        ]
    )
    rotation = _FLIP @ np.array([[number(pose, f"r{row}{column}", who) for column in (1, 2, 3)] for row in (1, 2, 3)])
    center = np.array([number(pose, axis, who) for axis in "xyz"]) / 1000.0
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = rotation
    world_to_camera[:3, 3] = -rotation @ center
    return Camera(name, width, height, K, world_to_camera, distortion if distortion.any() else np.zeros(0))
