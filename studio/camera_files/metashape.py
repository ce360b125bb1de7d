"""Camera exports of Agisoft Metashape (XML).

Follows the manual's appendix "Camera models" and exported files. A camera's `transform` is camera to chunk, row-major,
with OpenCV axes; the `transform` of the component (in older files, of the chunk) contains rotation, translation and
scale from chunk to world. u = w / 2 + cx + x' (f + b1) + y' b2, v = h / 2 + cy + y' f; the center of the upper left
pixel is (0.5, 0.5), as in `studio.cameras`. x' and y' follow Brown's model, with p1 and p2 swapped relative to OpenCV.
Cameras without a transform are either slaves of a master, or were not aligned and are left out, as disabled ones are.
A slave's sensor has `rotation` (slave to master) and `location` (in the master's axes; taken to be in the units of the
chunk, as Metashape's API says nothing else and chunks may have no scale). OpenCV has no k4 r^8 term: if a camera uses
it, OpenCV's rational model is fitted. The terms of a sensor of type fisheye apply to an equidistant projection.
"""

from collections.abc import Mapping
from xml.etree import ElementTree

import numpy as np

from v3studio.studio.camera_files.common import camera_names, check_pose, rigid_inverse, wrong_shape
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.lens_fit import brown
from v3studio.studio.cameras import Camera, Rig, focal_length_error
from v3studio.studio.counts import cameras_listed
from v3studio.studio.errors import StudioError
from v3studio.studio.validation import array, camera_error, check_finite, missing_key

Element = ElementTree.Element
_NOTICEABLE = 0.25  # pixels
_SAME_UNIT = 0.001  # difference of a chunk's scale from 1
_TERMS = frozenset({
    "resolution", "f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4", "covariance", "date",
})  # fmt: skip


def matches(file: CameraFile) -> bool:
    """Return whether a file has this form."""
    return file.xml is not None and file.xml.tag in ("document", "chunk")


def read(file: CameraFile) -> Rig:
    """Read the cameras of the first chunk."""
    root = file.xml
    assert root is not None
    chunk = root if root.tag == "chunk" else root.find("chunk")
    if chunk is None:
        fix = "Export the cameras from Metashape again: File, Export, Export Cameras, XML."
        raise StudioError("camera_file.no_cameras", "no <chunk> in the document", fix=fix)
    sensors = {sensor.get("id"): sensor for sensor in chunk.iter("sensor")}
    worlds = {part.get("id"): part.find("transform") for part in chunk.iter("component")}
    by_id = {camera.get("id"): camera for camera in chunk.iter("camera")}
    poses = {key: _in_chunk(camera, by_id, sensors) for key, camera in by_id.items()}
    enabled = {key for key, camera in by_id.items() if camera.get("enabled") not in ("false", "0")}
    used = {key for key, pose in poses.items() if pose is not None and key in enabled}
    if not used:
        problem = "no aligned and enabled cameras, that is, no <camera> with a <transform>"
        fix = "Align the photos in Metashape, then export again."
        raise StudioError("camera_file.no_cameras", problem, fix=fix)
    labels = []
    for index, camera in enumerate(by_id.values()):
        label = camera.get("label")
        if not label:
            raise missing_key("label", f"number {index + 1}")
        labels.append(label)
    names = camera_names(labels)
    own = chunk.find("transform")
    cameras: list[Camera] = []
    left_out: list[str] = []
    for name, (key, entry) in zip(names, by_id.items(), strict=True):
        pose = poses[key]
        if pose is None or key not in used:
            left_out.append(name)
            continue
        sensor = sensors.get(entry.get("sensor_id"))
        if sensor is None:
            problem = f"its sensor '{entry.get('sensor_id')}' was not found in the file"
            raise camera_error("camera.unknown_sensor", name, problem, value=entry.get("sensor_id"))
        world = worlds.get(entry.get("component_id"))
        cameras.append(_camera(name, pose, sensor, world if world is not None else own))
    slaves = [name for name, entry in zip(names, by_id.values(), strict=True) if entry.find("transform") is None]
    placed = [name for name in slaves if name not in left_out]
    apart = any(_has_text(sensor, "location") for sensor in sensors.values())
    scales = [_world(part, "")[2] for part in (*worlds.values(), own)] if apart else []
    chunks = [part.get("label") or "?" for part in root.iter("chunk")]
    notes = _offset_notes(placed, scales)
    if len(chunks) > 1:
        notes = (*notes, f"The file has {len(chunks)} chunks; the first is used, '{chunks[0]}'.")
    return Rig(tuple(cameras), notes, tuple(left_out))


def _offset_notes(placed: list[str], scales: list[float]) -> tuple[str, ...]:
    """A note on assumptions about cameras that are placed from their masters, by the scales of chunk and components."""
    if not placed:
        return ()
    note = f"Placed from their masters, with offsets in units of the chunk: {cameras_listed(placed)}."
    scale = max(scales, key=lambda scale: abs(scale - 1), default=1.0)
    if abs(scale - 1) < _SAME_UNIT:
        return (note,)
    return note, (
        f"One unit of the chunk is {scale:.4g} units of the world, and Metashape's manual does not say in which "
        "offsets are. If distances between these cameras are wrong by this factor, export them as COLMAP instead."
    )


def _in_chunk(
    entry: Element, by_id: Mapping[str | None, Element], sensors: Mapping[str | None, Element]
) -> np.ndarray | None:
    """(4, 4) camera to chunk; None if the camera was not aligned."""
    name = entry.get("label") or "?"
    if entry.find("transform") is not None:
        pose = _numbers(entry, "transform", 16, name).reshape(4, 4)
        check_pose(pose, "transform", name)
        return pose
    master, sensor = by_id.get(entry.get("master_id")), sensors.get(entry.get("sensor_id"))
    if master is None or master is entry or master.find("transform") is None or sensor is None:
        return None
    placed = _in_chunk(master, by_id, sensors)
    assert placed is not None
    # the master of cameras need not be that of sensors
    own = sensors.get(master.get("sensor_id"))
    before = np.eye(4) if own is None else rigid_inverse(_offset(own, name))
    return placed @ before @ _offset(sensor, name)


def _offset(sensor: Element, name: str) -> np.ndarray:
    """(4, 4) transform from a slave's sensor to its master's."""
    offset = np.eye(4)
    if _has_text(sensor, "rotation"):
        offset[:3, :3] = _numbers(sensor, "rotation", 9, name).reshape(3, 3)
    if _has_text(sensor, "location"):
        offset[:3, 3] = _numbers(sensor, "location", 3, name)
    return offset


def _has_text(element: Element, tag: str) -> bool:
    part = element.find(tag)
    return part is not None and bool(part.text and part.text.strip())


def _numbers(element: Element | None, tag: str, count: int, camera: str) -> np.ndarray:
    part = element.find(tag) if element is not None else None
    if part is None or not part.text:
        raise missing_key(tag, camera)
    value = array(part.text.split(), tag, camera)
    if value.size != count:
        raise wrong_shape(tag, camera, value.shape, ((count,),))
    check_finite(value, tag, camera)
    return value


def _camera(name: str, pose: np.ndarray, sensor: Element, world: Element | None) -> Camera:
    fisheye = _is_fisheye(name, "sensor", sensor)
    calibrations = {part.get("class", ""): part for part in sensor.findall("calibration")}
    calibration = calibrations.get("adjusted", calibrations.get("", calibrations.get("initial")))
    if calibration is None:
        raise missing_key("calibration", name)
    fisheye = _is_fisheye(name, "calibration", calibration) or fisheye
    for part in calibration:
        if part.tag not in _TERMS:
            problem = f"<{part.tag}> in <calibration> is not known and may change how the camera projects"
            fix = "Export the cameras again with Metashape 1.4 or later."
            raise camera_error("camera.unknown_key", name, problem, value=part.tag, fix=fix, key=part.tag)
    size = calibration.find("resolution")
    size = size if size is not None else sensor.find("resolution")
    if size is None or not (size.get("width", "").isdecimal() and size.get("height", "").isdecimal()):
        raise missing_key("resolution", name)
    width, height = int(size.get("width", "")), int(size.get("height", ""))

    def term(tag: str) -> float:
        return float(_numbers(calibration, tag, 1, name)[0]) if calibration.find(tag) is not None else 0.0

    focal = float(_numbers(calibration, "f", 1, name)[0])
    if focal <= 0:
        raise focal_length_error(name, focal)
    if abs(term("b2")) * 0.5 * height / focal > _NOTICEABLE:
        problem = f"skew is not supported, but <b2> is {term('b2'):g}"
        fix = "Align the photos again with b2 fixed at 0."
        raise camera_error("camera.skew", name, problem, value=term("b2"), fix=fix, key="b2")
    if term("p3") or term("p4"):
        problem = "the terms <p3> and <p4> are not supported"
        fix = "Align the photos again with p3 and p4 fixed at 0."
        raise camera_error("camera.lens_model", name, problem, value=[term("p3"), term("p4")], fix=fix)
    K = np.array([[focal + term("b1"), 0, width / 2 + term("cx")], [0, focal, height / 2 + term("cy")], [0, 0, 1.0]])
    k = [term(f"k{i}") for i in (1, 2, 3, 4)]
    p = (term("p2"), term("p1"))
    distortion = np.array([*k, *p, 0, 0]) if fisheye else brown(k, p, K, (width, height), name)
    rotation, translation, scale = _world(world, name)
    placed = np.column_stack([rotation @ pose[:3, :3], scale * rotation @ pose[:3, 3] + translation])
    return Camera(name, width, height, K, rigid_inverse(placed), distortion, fisheye)


def _is_fisheye(name: str, tag: str, element: Element) -> bool:
    kind = element.get("type", "frame")
    if kind not in ("frame", "fisheye"):
        problem = f"its {tag} is of type '{kind}'; only frame and fisheye cameras are supported"
        fix = "Undistort the images to a pinhole camera first."
        raise camera_error("camera.lens_model", name, problem, value=kind, fix=fix)
    return kind == "fisheye"


def _world(element: Element | None, name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Rotation, translation and scale from chunk to world; the identity if the chunk is not georeferenced."""
    if element is None or element.find("rotation") is None:
        return np.eye(3), np.zeros(3), 1.0
    return (
        _numbers(element, "rotation", 9, name).reshape(3, 3),
        _numbers(element, "translation", 3, name),
        float(_numbers(element, "scale", 1, name)[0]),
    )
