"""Cameras as people own them: where they stand, their lenses, sensors and clocks, and the files that describe them."""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

BOX_MARGIN = 0.025  # widths of the image beside people, in the box around them that is rendered for each frame


@dataclass(frozen=True)
class Lens:
    """The relation of rays and image. `kind`: "pinhole", "brown" (Brown-Conrady) or "fisheye" (Kannala-Brandt, as
    OpenCV).

    `focal` is in widths of the image; the principal point is the image's middle. `distortion`: k1, k2, p1, p2, k3 of
    OpenCV for "brown", k1 to k4 for "fisheye"."""

    kind: str = "pinhole"
    focal: float = 0.823
    distortion: tuple[float, ...] = ()

    def radius(self, angle: np.ndarray) -> np.ndarray:
        """Focal lengths from the image's middle at which a "fisheye" lens images rays at an angle to its axis."""
        k1, k2, k3, k4 = self.distortion
        return angle * (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8)

    def undistorted(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) points on the plane z = 1 that a "brown" lens images at normalized `points`, by iteration."""
        k1, k2, p1, p2, k3 = self.distortion
        result = points.copy()
        for _ in range(60):
            x, y = result[..., 0], result[..., 1]
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            shift = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=-1)
            result = (points - shift) / radial[..., None]
        return result


@dataclass(frozen=True)
class Camera:
    """A camera. Meters and seconds; the exposure of frame i begins at i / fps * (1 + drift) + offset."""

    name: str
    position: tuple[float, float, float]
    target: tuple[float, float, float] = (0.0, 0.0, 0.9)
    width: int = 640
    height: int = 360
    lens: Lens = field(default_factory=Lens)
    exposure: float = 0.0  # stops
    white: tuple[float, float, float] = (1.0, 1.0, 1.0)  # gains of linear R, G and B
    noise: float = 0.008  # standard deviation, share of full scale
    crf: int = 21  # quality of H.264; a lower one means more bytes
    offset: float = 0.0
    drift: float = 0.0  # parts
    shutter: float = 0.0  # how long each row is exposed; 0: an instant
    readout: float = 0.0  # rolling shutter: how much later the last row begins than the first
    held_out: bool = False

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) K in pixels; the pixel origin is the image's outer corner."""
        focal = self.lens.focal * self.width
        return np.array([[focal, 0, self.width / 2], [0, focal, self.height / 2], [0, 0, 1.0]])

    @property
    def world_to_camera(self) -> np.ndarray:
        """(3, 4) R and t, OpenCV axes."""
        position = np.array(self.position)
        forward = np.array(self.target) - position
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, (0, 0, 1))
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        return np.hstack([rotation, -rotation @ position[:, None]])


def ring(count: int, radius: float, heights: tuple[float, ...], **options: object) -> list[Camera]:
    """Cameras evenly around the middle axis, at the heights in turn."""
    cameras = []
    for number in range(count):
        angle = 2 * math.pi * number / count
        place = (radius * math.cos(angle), radius * math.sin(angle), heights[number % len(heights)])
        cameras.append(Camera(f"cam{number:02}", place, **options))  # type: ignore[arg-type]
    return cameras


def write_rig_files(folder: Path, cameras: list[Camera], fps: float, frames: int) -> None:
    """`cameras.json` (R, t and K), for Nerfstudio `transforms.json`, for OpenCV `intri.yml` and `extri.yml`, and the
    true clocks in `clocks.json`."""
    models = {"pinhole": "PINHOLE", "brown": "OPENCV", "fisheye": "OPENCV_FISHEYE"}
    rows, frames_of, intrinsics, extrinsics = [], [], [], []
    for camera in cameras:
        K, Rt, distortion = camera.matrix, camera.world_to_camera, list(camera.lens.distortion)
        size = {"width": camera.width, "height": camera.height}
        row = {"name": camera.name, **size, "K": K.tolist(), "R": Rt[:, :3].tolist(), "t": Rt[:, 3].tolist()}
        if distortion:
            row |= {"model": models[camera.lens.kind], "dist": distortion}
        rows.append(row)
        to_world = np.linalg.inv(np.vstack([Rt, (0, 0, 0, 1)])) @ np.diag((1, -1, -1, 1))
        names = {"brown": ("k1", "k2", "p1", "p2", "k3"), "fisheye": ("k1", "k2", "k3", "k4"), "pinhole": ()}[
            camera.lens.kind
        ]
        frames_of.append(
            {"file_path": f"videos/{camera.name}.mp4", "w": camera.width, "h": camera.height, "fl_x": K[0, 0],
             "fl_y": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], "camera_model": models[camera.lens.kind],
             **dict(zip(names, distortion, strict=True)), "transform_matrix": to_world.tolist()}
        )  # fmt: skip
        corner = K - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]  # OpenCV counts from the first pixel's center
        intrinsics += [
            _matrix(f"K_{camera.name}", corner),
            _matrix(f"dist_{camera.name}", np.array([distortion or [0.0] * 5])),
        ]
        extrinsics += [_matrix(f"Rot_{camera.name}", Rt[:, :3]), _matrix(f"T_{camera.name}", Rt[:, 3:])]
    head = {
        "convention": "OpenCV: x ~ K(RX+t); image origin top-left corner; pixel centers at +0.5",
        "unit": "meter",
        "up": "z",
    }
    _json(folder / "cameras.json", {**head, "fps": fps, "frames": frames, "cameras": rows})
    _json(folder / "transforms.json", {"frames": frames_of})
    named = "names:\n" + "".join(f'   - "{camera.name}"\n' for camera in cameras)
    for name, parts in (("intri", intrinsics), ("extri", extrinsics)):
        (folder / f"{name}.yml").write_text("%YAML:1.0\n---\n" + named + "".join(parts))
    clocks = {
        one.name: {"offset": one.offset, "drift": one.drift, "shutter": one.shutter, "readout": one.readout}
        for one in cameras
    }
    _json(folder / "clocks.json", {"unit": "second", "cameras": clocks})


def _matrix(name: str, matrix: np.ndarray) -> str:
    numbers = ", ".join(repr(float(number)) for number in matrix.ravel())
    rows, columns = matrix.shape
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [{numbers}]\n"


def _json(path: Path, document: object) -> None:
    path.write_text(json.dumps(document, indent=1) + "\n")
