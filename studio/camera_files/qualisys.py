"""Qualisys Track Manager calibrations (.qca.txt, XML).

Derived from files written by the program and by Pose2Sim:
- `transform` x y z is the camera center in millimeters; r11..r33 is a world-to-camera rotation with the axes x right,
  y up, z back, so y and z are negated here.
- `intrinsic` is in units of 1/64 pixel, so focal lengths and principal point are divided by 64. The principal point is
  relative to the full sensor, of which `fov_video` (inclusive bounds) is the recorded window; its origin is the center
  of the first pixel, as in OpenCV. Distortion is OpenCV's and has no unit. (Pose2Sim also divides the distortion by 64,
  but a calibration of the same lens with a board confirms the undivided values.)
- Cameras that only track markers are skipped if the file contains video cameras.
"""

from xml.etree import ElementTree

import numpy as np

from v3studio.studio.camera_files.common import no_cameras
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import FileNotes
from v3studio.studio.cameras import OPENGL_AXES, Camera, Rig
from v3studio.studio.counts import cameras_listed
from v3studio.studio.validation import missing_key, number

_SUBPIXELS = 64.0
_DISTORTION = (
    "radialDistortion1",
    "radialDistortion2",
    "tangentalDistortion1",  # spelled like this in the format
    "tangentalDistortion2",
    "radialDistortion3",
)
_INTRINSICS = {
    "focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew", "focallength",
    "sensorMinU", "sensorMaxU", "sensorMinV", "sensorMaxV", *_DISTORTION,
}  # fmt: skip


def matches(file: CameraFile) -> bool:
    """Return whether a file is a calibration with an element for the cameras."""
    return file.xml is not None and file.xml.find("cameras") is not None


def read(file: CameraFile) -> Rig:
    """Read the cameras in <calibration>, in meters."""
    assert file.xml is not None
    entries = [entry for entry in file.xml.findall("cameras/camera") if entry.get("active", "1") != "0"]
    video = [entry for entry in entries if _records_video(entry)]
    if not entries:
        raise no_cameras("no active cameras (calibration/cameras/camera)")
    notes = FileNotes()
    cameras = tuple(_camera(entry, index, notes) for index, entry in enumerate(video or entries))
    markers = [str(entry.get("serial")) for entry in entries if video and entry not in video]
    only = f"Left out, since they only track markers: {cameras_listed(markers)}."
    return Rig(cameras, (*notes.sentences, only) if markers else notes.sentences)


def _records_video(entry: ElementTree.Element) -> bool:
    model = entry.get("model", "none").lower()
    return any(word in model for word in ("video", "hybrid")) or model == "none"


def _camera(entry: ElementTree.Element, index: int, notes: FileNotes) -> Camera:
    name = entry.get("serial")
    if not name:
        raise missing_key("serial", f"number {index + 1}")

    def part(tag: str) -> dict[str, str]:
        element = entry.find(tag)
        if element is None:
            raise missing_key(tag, name)
        return dict(element.attrib)

    window, pose, intrinsics = part("fov_video"), part("transform"), part("intrinsic")
    left, top = number(window, "left", name), number(window, "top", name)
    width = round(number(window, "right", name) - left) + 1
    height = round(number(window, "bottom", name) - top) + 1
    K = np.eye(3)
    K[0, 0], K[1, 1] = (number(intrinsics, key, name) / _SUBPIXELS for key in ("focalLengthU", "focalLengthV"))
    K[0, 1] = number(intrinsics, "skew", name, 0.0) / _SUBPIXELS
    K[0, 2] = number(intrinsics, "centerPointU", name) / _SUBPIXELS - left + 0.5
    K[1, 2] = number(intrinsics, "centerPointV", name) / _SUBPIXELS - top + 0.5
    bent = any(key in intrinsics for key in _DISTORTION)
    missing = "" if bent else "lens distortion"
    notes.check_unknown(name, {key: intrinsics[key] for key in intrinsics.keys() - _INTRINSICS}, missing)
    (notes.bent if bent else notes.straight).append(name)
    distortion = np.array([number(intrinsics, key, name, 0.0) for key in _DISTORTION])
    rotation = np.array([[number(pose, f"r{row}{column}", name) for column in (1, 2, 3)] for row in (1, 2, 3)])
    rotation = OPENGL_AXES[:3, :3] @ rotation
    center = np.array([number(pose, axis, name) for axis in "xyz"]) / 1000.0
    world_to_camera = np.column_stack([rotation, -rotation @ center])
    return Camera(name, width, height, K, world_to_camera, distortion if distortion.any() else np.zeros(0))
