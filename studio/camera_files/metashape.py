"""Camera exports of Agisoft Metashape (XML).

After the manual's appendix "Camera models" and files that the program writes: a camera's `transform` is camera to
chunk, row by row, with OpenCV's axes; the component's `transform` (older files: the chunk's) is rotation, translation
and scale to the world. u = w / 2 + cx + x' (f + b1) + y' b2, v = h / 2 + cy + y' f, with the upper left pixel's center
at (0.5, 0.5), which is our origin. x' and y' follow Brown's model with p1 and p2 the other way round than in OpenCV.
Cameras without a transform were not aligned and are left out. OpenCV has no k4 r^8: where it is used, OpenCV's rational
model is fitted to it.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from studio.camera_files.common import camera_names, naming, rigid_inverse
from studio.camera_files.lens_fit import fit_rational, reach_of
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.validation import array, check_finite

Element = ElementTree.Element
_NOTICEABLE = 0.25  # pixels


def rig_from_metashape(path: Path, root: Element) -> Rig:
    """A rig from the file's root element <document>.

    Raises:
        StudioError: an element is missing, a number is unusable, a lens that is no frame camera.
    """
    with naming(path):
        chunk = root if root.tag == "chunk" else root.find("chunk")
        if chunk is None:
            raise StudioError("holds no <chunk>; export the cameras from Metashape again (File, Export, Cameras, XML).")
        sensors = {sensor.get("id"): sensor for sensor in chunk.iter("sensor")}
        worlds = {part.get("id"): part.find("transform") for part in chunk.iter("component")}
        entries = [camera for camera in chunk.iter("camera") if camera.find("transform") is not None]
        if not entries:
            raise StudioError("holds no aligned camera (a <camera> with a <transform>); align the photos first.")
        labels = []
        for index, camera in enumerate(entries):
            label = camera.get("label")
            if not label:
                raise StudioError(f"camera {index + 1} has no 'label'.")
            labels.append(label)
        names = camera_names(labels)
        own = chunk.find("transform")
        cameras = []
        for name, entry in zip(names, entries, strict=True):
            who = f"Camera '{name}'"
            sensor = sensors.get(entry.get("sensor_id"))
            if sensor is None:
                raise StudioError(f"{who}: its sensor '{entry.get('sensor_id')}' is not in the file.")
            world = worlds.get(entry.get("component_id"))
            cameras.append(_camera(name, entry, sensor, world if world is not None else own, who))
        return Rig(tuple(cameras))


def _numbers(element: Element | None, tag: str, count: int, who: str) -> np.ndarray:
    part = element.find(tag) if element is not None else None
    if part is None or not part.text:
        raise StudioError(f"{who}: the element <{tag}> is missing.")
    value = array(part.text.split(), f"<{tag}>", who)
    if value.size != count:
        raise StudioError(f"{who}: <{tag}> has {value.size} numbers; {count} are needed.")
    check_finite(value, f"<{tag}>", who)
    return value


def _camera(name: str, entry: Element, sensor: Element, world: Element | None, who: str) -> Camera:
    kind = sensor.get("type", "frame")
    if kind != "frame":
        raise StudioError(f"{who}: its sensor is '{kind}'; only frame cameras are supported, undistort the images.")
    calibrations = {part.get("class", ""): part for part in sensor.findall("calibration")}
    calibration = calibrations.get("adjusted", calibrations.get("", calibrations.get("initial")))
    if calibration is None:
        raise StudioError(f"{who}: its sensor has no <calibration>; align the photos first.")
    size = calibration.find("resolution")
    size = size if size is not None else sensor.find("resolution")
    if size is None or not (size.get("width", "").isdecimal() and size.get("height", "").isdecimal()):
        raise StudioError(f"{who}: its sensor has no <resolution> with width and height.")
    width, height = int(size.get("width", "")), int(size.get("height", ""))

    def term(tag: str) -> float:
        return float(_numbers(calibration, tag, 1, who)[0]) if calibration.find(tag) is not None else 0.0

    focal = float(_numbers(calibration, "f", 1, who)[0])
    if focal <= 0:
        raise StudioError(f"{who}: <f> is {focal:g}; a focal length must be positive.")
    if abs(term("b2")) * 0.5 * height / focal > _NOTICEABLE:
        raise StudioError(f"{who}: <b2> is {term('b2'):g}; skew is not supported, align again with b2 fixed at 0.")
    if term("p3") or term("p4"):
        raise StudioError(f"{who}: <p3> and <p4> are not supported; align again with them fixed at 0.")
    K = np.array([[focal + term("b1"), 0, width / 2 + term("cx")], [0, focal, height / 2 + term("cy")], [0, 0, 1.0]])
    lens = _lens(K, width, height, [term(f"k{i}") for i in (1, 2, 3, 4)], term("p1"), term("p2"), who)
    pose = _numbers(entry, "transform", 16, who).reshape(4, 4)
    if np.abs(pose[3] - [0, 0, 0, 1]).max() > 1e-6:
        raise StudioError(f"{who}: the last row of <transform> is {pose[3].tolist()}; it must be 0 0 0 1.")
    rotation, translation, scale = _world(world, who)
    placed = np.eye(4)
    placed[:3, :3] = rotation @ pose[:3, :3]
    placed[:3, 3] = scale * rotation @ pose[:3, 3] + translation
    return Camera(name, width, height, K, rigid_inverse(placed), lens)


def _lens(K: np.ndarray, width: int, height: int, k: list[float], p1: float, p2: float, who: str) -> np.ndarray:
    """OpenCV's coefficients."""
    if not k[3]:
        lens = np.array([k[0], k[1], p2, p1, k[2]])
        return lens if lens.any() else np.zeros(0)

    def radial(r: np.ndarray) -> np.ndarray:
        s = r * r
        return 1 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))

    focal = float(min(K[0, 0], K[1, 1]))
    lens = fit_rational(radial, reach_of(radial, focal, K[:2, 2], np.array([width, height])), focal, who)
    lens[2:4] = p2, p1
    return lens


def _world(element: Element | None, who: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Rotation, translation and scale from the chunk to the world; nothing where the chunk is not referenced."""
    if element is None or element.find("rotation") is None:
        return np.eye(3), np.zeros(3), 1.0
    return (
        _numbers(element, "rotation", 9, who).reshape(3, 3),
        _numbers(element, "translation", 3, who),
        float(_numbers(element, "scale", 1, who)[0]),
    )
