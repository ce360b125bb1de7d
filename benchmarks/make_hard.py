"""Makes a synthetic capture that is hard for masks, with exact masks: thin parts, or colored shadows.

    python benchmarks/make_hard.py thin|shadows FOLDER [--frames N]
    v3studio run FOLDER/own.yaml --take TAKE

A performer stands in a room between 12 cameras and moves by up to 2 cm per frame. `thin`: loose strands of hair 1 to 3
pixels wide, fingers and a staff before patterned walls. `shadows`: three colored lights, so that each shadow on the
saturated floor has a color of its own. Images are ray traced with nine rays per pixel, shadows included; each light
has a size. The same arguments give the same images.

    videos/camNN.mp4              H.264, 4:2:0, with sensor noise of 1.2% of full scale
    clean_plates/camNN.png        the empty room, without noise
    mattes/camNN/NNNNNN.png       exact masks
    cameras.json                  calibration (OpenCV axes, meters, z up)
    own.yaml, exact.yaml          settings: the quickstart's training from clean plates (with mask_shadows: colored) or
                                  from the exact masks, cam03 and cam08 held out, evaluated with the exact masks
"""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from make_dancer import (
    HEIGHT,
    WIDTH,
    Body,
    Part,
    limb,
    pixel_rays,
    to_bytes,
    turn,
    two_rings,
    write_image,
    write_settings,
)

from v3studio.studio.camera_files import write_rig
from v3studio.studio.cameras import Camera

CAMERAS = 12
FPS = 25
NOISE = 0.012
CRF = 18
ROOM, CEILING = 4.6, 3.2  # half of the room's width, and its height, in meters
SAMPLES = [((x + 0.5) / 3, (y + 0.5) / 3) for y in range(3) for x in range(3)]  # rays of a pixel, in fractions of it


@dataclass(frozen=True)
class Light:
    """A spherical light. `color` is what it adds to a surface that faces it."""

    place: tuple[float, float, float]
    color: tuple[float, float, float]
    radius: float


@dataclass(frozen=True)
class Scene:
    """The differences between the captures: lights, room, and whether the performer has thin parts."""

    lights: tuple[Light, ...]
    ambient: float
    floor: tuple[float, float, float]
    walls: tuple[float, float, float]
    pattern: float  # contrast of the room
    thin: bool


SCENES = {
    "thin": Scene((Light((1.5, -2.5, 3.1), (0.6,) * 3, 0.3),), 0.45, (0.5, 0.42, 0.36), (0.55, 0.53, 0.5), 0.6, True),
    "shadows": Scene(
        (
            Light((2.4, -2.0, 2.9), (0.62, 0.30, 0.20), 0.08),
            Light((-2.6, -1.6, 2.7), (0.16, 0.30, 0.62), 0.08),
            Light((0.3, 2.8, 3.0), (0.22, 0.45, 0.18), 0.08),
        ),
        0.22,
        (0.88, 0.36, 0.12),
        (0.30, 0.52, 0.55),
        0.15,
        False,
    ),
}


def hand(wrist: np.ndarray, axes: np.ndarray) -> list[Part]:
    """A palm with five spread fingers, each about two pixels wide."""
    parts = [Part(wrist - axes[:, 2] * 0.05, axes, np.array([0.045, 0.02, 0.055]), 2)]
    for finger in range(5):
        spread = axes @ turn("y", 0.32 * (finger - 2))
        base = wrist - axes[:, 2] * 0.085 - axes[:, 0] * 0.018 * (finger - 2)
        parts.append(limb(base, spread, 0.085, 0.0085, 2)[0])
    return parts


def hair(center: np.ndarray, time: float) -> list[Part]:
    """Loose strands that bend and sway, 6 to 20 mm thick: 1 to 3 pixels."""
    random = np.random.default_rng(7)
    parts = []
    for _strand in range(34):
        around, radius = random.uniform(0, 2 * math.pi), random.uniform(0.003, 0.010)
        tilt = random.uniform(1.6, 2.5)
        at = center + 0.1 * np.array([math.cos(around), math.sin(around), 0.7])
        for _ in range(5):
            tilt -= 0.32 + 0.12 * math.sin(9 * time + around)
            axes = turn("z", around) @ turn("y", math.pi - max(tilt, 0.35) + math.pi)
            strand, at = limb(at, axes, 0.06, radius, 3)
            parts.append(strand)
    return parts


def performer(time: float, thin: bool) -> list[Part]:
    """The body at a time in seconds, with soles on the floor."""
    beat = 2 * math.pi * 0.5 * time
    body = turn("z", 0.35 * math.sin(beat))
    hips = np.array([0.03 * math.sin(beat), 0.0, 0.92])
    at = lambda x, y, z: hips + body @ np.array([x, y, z])  # noqa: E731
    parts = [
        Part(at(0, 0, 0.24), body, np.array([0.19, 0.12, 0.32]), 0),
        Part(at(0, 0, -0.06), body, np.array([0.18, 0.13, 0.15]), 1),
        Part(at(0, 0, 0.68), body, np.array([0.10, 0.115, 0.14]), 2),
        Part(at(0, 0.03, 0.74), body, np.array([0.115, 0.115, 0.12]), 3),
    ]
    for side in (-1, 1):
        upper = body @ turn("y", -side * (0.75 + 0.2 * math.sin(beat))) @ turn("x", 0.3)
        lower = upper @ turn("x", 0.7 + 0.15 * math.sin(beat + side))
        arm, elbow = limb(at(side * 0.2, 0, 0.46), upper, 0.27, 0.045, 0)
        fore, wrist = limb(elbow, lower, 0.24, 0.036, 2)
        parts += [arm, fore, *hand(wrist, lower)]
        if thin and side > 0:
            parts.append(Part(wrist - lower[:, 2] * 0.07, turn("x", 0.15), np.array([0.011, 0.011, 0.85]), 4))
        foot = np.array([side * 0.14, 0.0, 0.045])
        hip = at(side * 0.1, 0, -0.08)
        for start, end, radius in ((hip, (hip + foot) / 2 - [0, 0.03, 0], 0.075), ((hip + foot) / 2, foot, 0.055)):
            down = (start - end) / np.linalg.norm(start - end)
            across = np.cross([0, 1.0, 0], down)
            across /= np.linalg.norm(across)
            axes = np.stack([across, np.cross(down, across), down], axis=1)
            parts.append(limb(start, axes, float(np.linalg.norm(start - end)), radius, 1)[0])
        parts.append(Part(foot - np.array([0, 0.06, 0]), np.eye(3), np.array([0.05, 0.13, 0.045]), 3))
    if thin:
        parts += hair(at(0, 0.02, 0.72), time)
    return parts


def wall_picture(contrast: float) -> np.ndarray:
    """(1024, 1024, 3) float32 factors around 1: spots of several sizes and rectangles, for walls and floor."""
    random = np.random.default_rng(11)
    total = np.zeros((1024, 1024, 3), np.float32)
    for size in (8, 32, 128, 512):
        spots = random.standard_normal((size, size, 3)).astype(np.float32) * [1.0, 0.9, 0.8]
        total += 0.12 * cv2.resize(spots.astype(np.float32), (1024, 1024), interpolation=cv2.INTER_CUBIC)
    for _ in range(90):
        left, top = random.integers(0, 960, 2)
        wide, high = random.integers(20, 130, 2)
        total[top : top + high, left : left + wide] += random.uniform(-0.45, 0.45, 3)
    return np.asarray(np.clip(1 + contrast * total, 0.15, 1.9), np.float32)


class Room:
    """The room as one camera sees it: what does not change from frame to frame."""

    def __init__(self, scene: Scene, camera: Camera, picture: np.ndarray) -> None:
        self.scene, self.origin = scene, camera.center
        self.rays: list[np.ndarray] = []
        self.albedo: list[np.ndarray] = []
        self.points: list[np.ndarray] = []
        self.shade: list[list[np.ndarray]] = []
        high = np.array([ROOM, ROOM, CEILING])
        low = np.array([-ROOM, -ROOM, 0.0])
        for dx, dy in SAMPLES:
            ray = pixel_rays(camera, dx, dy)
            distance = np.where(ray > 0, high - self.origin, low - self.origin) / ray
            axis = distance.argmin(-1)
            point = self.origin + ray * distance.min(-1)[..., None]
            u = np.where(axis == 0, point[..., 1], point[..., 0]) / 3 + 0.31 * axis
            v = np.where(axis == 2, point[..., 1], point[..., 2]) / 3
            place = [np.asarray((1024 * value) % 1024, np.float32) for value in (u, v)]
            pattern = cv2.remap(picture, place[0], place[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
            floor = ((axis == 2) & (point[..., 2] < 0.1))[..., None]
            self.albedo.append(np.clip(np.where(floor, scene.floor, scene.walls) * pattern, 0, 1).astype(np.float32))
            self.rays.append(ray)
            self.points.append(point)
            normal = np.zeros_like(point)
            np.put_along_axis(normal, axis[..., None], -np.sign(np.take_along_axis(ray, axis[..., None], -1)), -1)
            self.shade.append([_facing(light, point, normal) for light in scene.lights])

    def color(self, sample: int, lit: list[np.ndarray] | None) -> np.ndarray:
        """(H, W, 3) linear sum of the lights at one ray per pixel; `lit` (H, W) per light says how much arrives."""
        total = np.full((HEIGHT, WIDTH, 3), self.scene.ambient)
        for index, light in enumerate(self.scene.lights):
            share = self.shade[sample][index] if lit is None else self.shade[sample][index] * lit[index]
            total += share[..., None] * light.color
        return np.asarray(np.clip(self.albedo[sample] * total, 0, 1))


def _facing(light: Light, point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(...,) cosine between the normals (..., 3) and the directions from points (..., 3) to a light, at least 0."""
    toward = np.asarray(light.place) - point
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    return np.maximum((toward * normal).sum(-1), 0)


def draw(room: Room, body: Body, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) image in 0..1 and (H, W) the share of each pixel that the performer covers."""
    low, high = body.centers.min(0) - 0.25, body.centers.max(0) + 0.25
    total, covered = np.zeros((HEIGHT, WIDTH, 3)), np.zeros((HEIGHT, WIDTH))
    for sample in range(len(SAMPLES)):
        # A ray that misses the box around the performer misses the performer.
        sides = np.stack([(low - room.origin) / room.rays[sample], (high - room.origin) / room.rays[sample]])
        near = sides.min(0).max(-1) < sides.max(0).min(-1)
        lit, points = [], room.points[sample]
        for light in room.scene.lights:
            # Each ray sees another place of the light, so nine of them show its size.
            places = np.asarray(light.place) + light.radius * random.standard_normal(points.shape) / math.sqrt(3)
            ends = np.stack([(low - points) / (places - points), (high - points) / (places - points)])
            may = ends.min(0).max(-1) < ends.max(0).min(-1)
            arrives = np.ones((HEIGHT, WIDTH))
            arrives[may] = ~body.blocks(points[may], places[may])
            lit.append(arrives)
        color = room.color(sample, lit)
        hit, point, colors, normal = body.hit(room.origin, room.rays[sample][near])
        light_sum = np.full((len(point), 3), room.scene.ambient)
        for light in room.scene.lights:
            light_sum += _facing(light, point, normal)[:, None] * light.color
        drawn = color[near]
        drawn[hit] = np.clip(colors * light_sum, 0, 1)
        color[near] = drawn
        inside = covered[near]
        inside[hit] += 1
        covered[near] = inside
        total += color
    return total / len(SAMPLES), covered / len(SAMPLES)


def write_video(path: Path, images: list[np.ndarray]) -> None:
    """H.264, 4:2:0, from (H, W, 3) uint8 RGB."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=FPS, options={"crf": str(CRF), "threads": "1"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", choices=sorted(SCENES))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, default=3)
    arguments = parser.parse_args()
    scene, folder = SCENES[arguments.scene], arguments.folder
    rig = two_rings(CAMERAS, 0.5, (1.9, 1.0), (0, 0, 0.95))
    folder.mkdir(parents=True, exist_ok=True)
    write_rig(rig, folder / "cameras.json")
    random, picture = np.random.default_rng(0), wall_picture(scene.pattern)
    bodies = [Body(performer(frame / FPS, scene.thin)) for frame in range(arguments.frames)]
    for camera in rig.cameras:
        room = Room(scene, camera, picture)
        plate = np.mean([room.color(sample, None) for sample in range(len(SAMPLES))], axis=0)
        write_image(folder / "clean_plates" / f"{camera.name}.png", plate)
        images = []
        for frame, body in enumerate(bodies):
            image, mask = draw(room, body, random)
            images.append(to_bytes(image + NOISE * random.standard_normal(image.shape)))
            write_image(folder / "mattes" / camera.name / f"{frame:06d}.png", mask)
        write_video(folder / "videos" / f"{camera.name}.mp4", images)
        print(f"{camera.name} of {CAMERAS} cameras", flush=True)
    mattes = "mattes/{camera}/{frame:06d}.png"
    files = {"images": "videos/{camera}.mp4", "clean_plates": "clean_plates/{camera}.png"}
    own, exact = {"masks": "clean_plate", "mask_shadows": "colored"}, {"masks": "files", "mask_files": mattes}
    for name, masks in {"own": own, "exact": exact}.items():
        capture = {**files, **masks, "held_out": ["cam03", "cam08"]}
        write_settings(folder / f"{name}.yaml", arguments.frames, capture, evaluate={"exact_masks": mattes})


if __name__ == "__main__":
    main()
