"""Makes a synthetic capture: a dancer of textured ellipsoids and capsules, filmed by cameras in two rings.

    python benchmarks/make_dancer.py FOLDER [--frames N]
    v3studio run FOLDER/dancer.yaml --take TAKE

It differs from the sample capture in body, texture, light and speed: hands move by up to 0.3 m per frame. Images are
ray traced with four rays per pixel; the alpha channel is the exact mask. The same arguments give the same files.

    images/camNN/NNNNNN.png   RGBA, colors not premultiplied, with sensor noise of 2% of full scale
    cameras.json              calibration (OpenCV axes, meters, z up)
    dancer.yaml               settings: the quickstart's training, cam05 and cam11 held out
"""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import open3d as o3d

from v3studio.studio.camera_files import write_rig
from v3studio.studio.cameras import Camera, Rig, look_at_pose
from v3studio.studio.yaml_text import dump_yaml, parse_yaml

CAMERAS = 16
WIDTH, HEIGHT, FOCAL = 640, 360, 527.0
FPS = 25.0
NOISE = 0.02
SAMPLES = ((0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75))  # rays of a pixel, in fractions of it


@dataclass
class Part:
    """A part of the body in a frame."""

    center: np.ndarray  # (3,) position in meters
    axes: np.ndarray  # (3, 3) rotation, columns are the part's axes in the world
    size: np.ndarray  # (3,) half axes in meters
    kind: int  # index of its texture


def turn(axis: str, angle: float) -> np.ndarray:
    """(3, 3) rotation by an angle in radians about x, y or z."""
    vector = np.zeros(3)
    vector["xyz".index(axis)] = angle
    return np.asarray(cv2.Rodrigues(vector)[0])


def limb(start: np.ndarray, rotation: np.ndarray, length: float, radius: float, kind: int) -> tuple[Part, np.ndarray]:
    """A limb that hangs from `start` along the rotation's -z, and its end."""
    end = start - rotation[:, 2] * length
    return Part((start + end) / 2, rotation, np.array([radius, radius, length / 2 + 0.6 * radius]), kind), end


def dancer(time: float) -> list[Part]:
    """The body at a time in seconds."""
    beat = 2 * math.pi * 1.1 * time
    body = turn("z", 1.6 * time + 0.5 * math.sin(beat)) @ turn("x", 0.12 * math.sin(beat))
    hips = np.array([0.25 * math.sin(1.7 * time), 0.2 * math.cos(2.3 * time) - 0.2, 0.98 + 0.09 * abs(math.sin(beat))])
    at = lambda x, y, z: hips + body @ np.array([x, y, z])  # noqa: E731
    parts = [
        Part(at(0, 0, 0.22), body, np.array([0.19, 0.13, 0.32]), 0),
        Part(at(0, 0, -0.12), body, np.array([0.30, 0.28, 0.16]), 1),
        Part(at(0, 0, 0.70), body @ turn("z", 0.6 * math.sin(beat / 2)), np.array([0.11, 0.13, 0.15]), 2),
        Part(at(0, 0.10, 0.72), body, np.array([0.13, 0.10, 0.17]), 3),
    ]
    for side in (-1, 1):
        swing = beat + (0 if side > 0 else 2.1)
        upper = body @ turn("y", -side * (1.3 + 0.9 * math.sin(swing))) @ turn("x", 0.8 * math.cos(swing))
        lower = upper @ turn("x", 0.9 + 0.8 * math.sin(swing + 1))
        arm, elbow = limb(at(side * 0.21, 0, 0.45), upper, 0.28, 0.05, 0)
        fore, hand = limb(elbow, lower, 0.26, 0.04, 2)
        parts += [arm, fore, Part(hand, lower, np.array([0.05, 0.035, 0.08]), 2)]
        kick = beat / 2 + (0 if side > 0 else math.pi)
        thigh = body @ turn("x", -0.7 * math.sin(kick)) @ turn("y", -side * 0.15)
        shin = thigh @ turn("x", 0.5 + 0.5 * math.cos(kick))
        leg, knee = limb(at(side * 0.11, 0, -0.12), thigh, 0.42, 0.085, 4)
        calf, foot = limb(knee, shin, 0.42, 0.06, 4)
        parts += [leg, calf, Part(foot - shin[:, 1] * 0.06, shin, np.array([0.05, 0.13, 0.045]), 3)]
    return parts


def texture(kind: np.ndarray, local: np.ndarray) -> np.ndarray:
    """(R, 3) RGB in 0 to 1 of points (R, 3) in meters in the axes of parts of a kind (R,)."""
    x, y, z = local.T
    fine = np.sin(61 * x + 3 * np.sin(23 * z)) * np.sin(57 * y) * np.sin(67 * z)
    check = np.sign(np.sin(44 * (x + y)) * np.sin(44 * z))
    stripes = np.sin(70 * z + 4 * np.sin(12 * x))
    base = np.array(
        [[0.75, 0.20, 0.22], [0.16, 0.28, 0.62], [0.80, 0.60, 0.47], [0.20, 0.13, 0.10], [0.22, 0.42, 0.30]]
    )
    pattern = np.choose(kind, [check, stripes, 0.5 * fine, 0.8 * stripes * fine, 0.7 * check * fine])
    other = np.array(
        [[0.92, 0.86, 0.70], [0.85, 0.75, 0.30], [0.62, 0.42, 0.33], [0.42, 0.30, 0.20], [0.52, 0.66, 0.30]]
    )
    share = (0.5 + 0.5 * np.tanh(2 * pattern))[:, None]
    shade = 1 + 0.12 * fine[:, None]
    return np.asarray(np.clip((base[kind] * (1 - share) + other[kind] * share) * shade, 0, 1))


def two_rings(count: int, first: float, high_low: tuple[float, float], target: tuple[float, float, float]) -> Rig:
    """`count` cameras at a distance of 3.4 m around a target, every other one lower.

    Args:
        first: direction of the first one, in steps from one camera to the next.
        high_low: heights in meters of the even and of the odd ones.
        target: where they look, in meters.
    """
    cameras = []
    for number in range(count):
        angle = 2 * math.pi * (number + first) / count
        center = np.array([3.4 * math.cos(angle), 3.4 * math.sin(angle) + target[1], high_low[number % 2]])
        pose = look_at_pose(center, np.array(target), np.array([0, 0, 1.0]))
        matrix = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
        cameras.append(Camera(f"cam{number:02d}", WIDTH, HEIGHT, matrix, pose))
    return Rig(tuple(cameras))


def pixel_rays(camera: Camera, dx: float, dy: float) -> np.ndarray:
    """(H, W, 3) directions from a camera in the world, through the same place of each pixel, in fractions of it."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    pixel = np.stack([columns + dx, rows + dy, np.ones_like(rows, float)], -1)
    return np.asarray(pixel @ np.linalg.inv(camera.K).T @ camera.rotation)


class Body:
    """A performer in one frame, as a thing to cast rays at."""

    def __init__(self, parts: list[Part]) -> None:
        self.centers = np.array([part.center for part in parts])
        self.axes = np.array([part.axes for part in parts])
        self.sizes = np.array([part.size for part in parts])
        self.kinds = np.array([part.kind for part in parts])
        self.scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        for part in parts:
            sphere = o3d.geometry.TriangleMesh.create_sphere(1.0, 48 if part.size.min() > 0.015 else 12)
            mesh = o3d.t.geometry.TriangleMesh.from_legacy(sphere)
            points = (np.asarray(sphere.vertices) * part.size) @ part.axes.T + part.center
            mesh.vertex.positions = o3d.core.Tensor(points.astype(np.float32))
            self.scene.add_triangles(mesh)

    def hit(self, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Cast rays (..., 3) from an origin (3,): (...,) bool, whether they meet the body, and of those M that do, (M,
        3) points, (M, 3) RGB of the texture there in 0 to 1, and (M, 3) unit normals."""
        packed = np.concatenate([np.broadcast_to(origin, rays.shape), rays], -1).astype(np.float32)
        hits = self.scene.cast_rays(o3d.core.Tensor(packed), nthreads=1)
        distance = hits["t_hit"].numpy()
        hit = np.isfinite(distance)
        which = hits["geometry_ids"].numpy()[hit]
        points = origin + rays[hit] * distance[hit][:, None]
        local = np.einsum("rij,ri->rj", self.axes[which], points - self.centers[which])
        normal = np.einsum("rij,rj->ri", self.axes[which], local / self.sizes[which] ** 2)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return hit, points, texture(self.kinds[which], local), normal

    def blocks(self, points: np.ndarray, toward: np.ndarray) -> np.ndarray:
        """(N,) bool: something lies between the points (N, 3) and the places (N, 3)."""
        packed = np.concatenate([points, toward - points], -1).astype(np.float32)
        return np.asarray(self.scene.test_occlusions(o3d.core.Tensor(packed), 1e-3, 1.0, nthreads=1).numpy())


def render(body: Body, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) mean color of the dancer in each pixel, 0 to 1, and (H, W) the share of the pixel that they cover."""
    light = np.array([0.4, -0.5, 0.77])
    total, covered = np.zeros((HEIGHT, WIDTH, 3)), np.zeros((HEIGHT, WIDTH))
    for dx, dy in SAMPLES:
        hit, _, color, normal = body.hit(camera.center, pixel_rays(camera, dx, dy))
        total[hit] += color * (0.55 + 0.45 * np.maximum(normal @ light, 0))[:, None]
        covered[hit] += 1
    return total / np.maximum(covered, 1)[..., None], covered / len(SAMPLES)


def write_settings(path: Path, frames: int, capture: dict[str, Any], **sections: dict[str, Any]) -> None:
    """The settings of the quickstart with another capture and sections, and all frames in one group."""
    quickstart = Path(__file__).parent.parent / "sample_configs" / "quickstart.yaml"
    settings = parse_yaml(quickstart.read_text()) | {"evaluate": {}} | sections
    settings["capture"] = {"root": ".", "rig": "cameras.json", **capture}
    settings["train"]["group_size"] = frames
    path.write_text(dump_yaml(settings))


def write_image(path: Path, image: np.ndarray) -> None:
    """A PNG of an image in 0 to 1: gray, RGB or RGBA."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = to_bytes(image)
    if pixels.ndim == 3:  # OpenCV's order is BGR
        pixels[..., :3] = pixels[..., 2::-1].copy()
    cv2.imwrite(str(path), pixels)


def to_bytes(image: np.ndarray) -> np.ndarray:
    """uint8 of an image in 0 to 1."""
    return np.round(255 * np.clip(image, 0, 1)).astype(np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, default=16)
    arguments = parser.parse_args()
    rig, folder = two_rings(CAMERAS, 0, (1.9, 0.9), (0, -0.2, 0.95)), arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    write_rig(rig, folder / "cameras.json")
    generator = np.random.default_rng(0)
    for frame in range(arguments.frames):
        body = Body(dancer(frame / FPS))
        for camera in rig.cameras:
            color, alpha = render(body, camera)
            noisy = np.clip(color + NOISE * generator.standard_normal(color.shape), 0, 1) * (alpha > 0)[..., None]
            write_image(folder / "images" / camera.name / f"{frame:06d}.png", np.dstack([noisy, alpha]))
        print(f"frame {frame + 1} of {arguments.frames}", flush=True)
    images = {"images": "images/{camera}/{frame:06d}.png", "masks": "alpha", "fps": FPS}
    write_settings(folder / "dancer.yaml", arguments.frames, {**images, "held_out": ["cam05", "cam11"]})


if __name__ == "__main__":
    main()
