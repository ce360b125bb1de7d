"""Time, memory and accuracy of structure from motion on synthetic rigs with known ground truth.

    python benchmarks/calibration.py [--cameras 24] [--size 1920x1080] [--spread 0.01]

Renders a room of 8 x 8 x 3.5 meters with four pillars near its center, painted with noise at all scales, from cameras
that are arranged in rings and look at the center. Adds sensor noise, and calibrates from the images alone. The focal
lengths of the cameras differ by `--spread` (0: all are equal).
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from studio.calibration import CalibrateSettings, calibrate_from_images, compare_rigs
from studio.cameras import Camera, Rig
from studio.export.camera_path import look_at

Walls = list[np.ndarray]

HALF = np.array([4.0, 4.0, 1.75])
"""Half the size of the room in meters; the origin is at its center."""
PILLARS = ((0.5, 0.4, -0.6), (-0.6, 0.3, -0.3), (-0.2, -0.6, 0.0), (0.4, -0.4, -0.8))
"""x, y and height of the top of each pillar in meters. Pillars are 0.5 m wide and stand on the floor."""
PER_METER = 400


def paint(rng: np.random.Generator, width: float, height: float) -> np.ndarray:
    """(h, w, 3) uint8 texture with noise at all scales from 5 mm to 2 m, for a wall of the given size in meters."""
    shape = (round(height * PER_METER), round(width * PER_METER))
    wall = np.zeros((*shape, 3), np.float32)
    for cell in (2, 5, 12, 30, 80, 200, 800):
        coarse = rng.random((shape[0] // cell + 2, shape[1] // cell + 2, 3), np.float32) - 0.5
        wall += cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_LINEAR) * (0.6 if cell < 6 else 1.0)
    return np.clip(128 + 70 * wall, 0, 255).astype(np.uint8)


def draw(camera: Camera, room: Walls, pillars: list[Walls], rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) uint8: image of the camera, with noise of 2 gray levels."""
    x, y = np.meshgrid(*[np.arange(n, dtype=np.float32) + 0.5 for n in (camera.width, camera.height)])
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], -1)
    rays = rays.astype(np.float32) @ camera.rotation.astype(np.float32)  # R^T d, as row vectors
    image = np.zeros((*x.shape, 3), np.uint8)
    nearest = np.full(x.shape, np.inf, np.float32)
    for number, walls in enumerate([room, *pillars]):
        low, high = box(number)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(end - camera.center).astype(np.float32) / rays for end in (low, high)])
        enter, leave = ends.min(0), ends.max(0)
        # the room is visible where a ray leaves it, a pillar where a ray enters it
        reach, axis = (leave.min(-1), leave.argmin(-1)) if number == 0 else (enter.max(-1), enter.argmax(-1))
        seen = (enter.max(-1) < leave.min(-1)) & (reach > 0) & (reach < nearest)
        for side, wall in enumerate(walls):
            number_of_axis, (across, up) = side // 2, ((1, 2), (0, 2), (0, 1))[side // 2]
            rows, columns = np.nonzero(seen & (axis == number_of_axis))
            hit = camera.center + rays[rows, columns] * reach[rows, columns, None]
            there = (hit[:, number_of_axis] > (low + high)[number_of_axis] / 2) == bool(side % 2)
            rows, columns, hit = rows[there], columns[there], hit[there]
            places = ((hit[:, [across, up]] - low[[across, up]]) * PER_METER).astype(np.float32)
            image[rows, columns] = sample(wall, places)
        nearest[seen] = reach[seen]
    soft = cv2.GaussianBlur(image, (0, 0), 0.7)  # blur of a lens, without which the finest noise would alias
    return np.clip(soft + rng.normal(0, 2, soft.shape), 0, 255).astype(np.uint8)


def sample(wall: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(N, 3) uint8 colors of a wall, interpolated at positions (N, 2); in rows, since OpenCV limits maps to 32,767."""
    width = 4096
    rows = -(-len(places) // width)
    if rows == 0:
        return np.zeros((0, 3), np.uint8)
    maps = np.zeros((rows * width, 2), np.float32)
    maps[: len(places)] = places
    x, y = maps.reshape(rows, width, 2).transpose(2, 0, 1)
    colors = cv2.remap(wall, np.ascontiguousarray(x), np.ascontiguousarray(y), cv2.INTER_LINEAR,
                        borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
    return colors.reshape(-1, 3)[: len(places)]


def box(number: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner of the room (0) or of a pillar (1, 2, ...), in meters."""
    if number == 0:
        return -HALF, HALF
    x, y, top = PILLARS[number - 1]
    return np.array([x - 0.25, y - 0.25, -HALF[2]]), np.array([x + 0.25, y + 0.25, top])


def painted(number: int, rng: np.random.Generator) -> Walls:
    """Textures of the six sides of a box: two perpendicular to x, two to y, two to z."""
    low, high = box(number)
    x, y, z = high - low
    return [paint(rng, *side) for side in ((y, z), (y, z), (x, z), (x, z), (x, y), (x, y))]


def ring(count: int, size: tuple[int, int], spread: float, rng: np.random.Generator) -> Rig:
    """Cameras in rings of up to 27 at several heights, three meters from the center, looking slightly past it."""
    rings = -(-count // 27)
    cameras = []
    for index in range(count):
        level, angle = index % rings, 2 * np.pi * index / count
        height = -0.6 + 1.4 * (level + 0.5) / rings
        center = np.array([3 * np.cos(angle), 3 * np.sin(angle), height]) + rng.normal(0, 0.05, 3)
        target = rng.normal(0, 0.15, 3)
        focal = 0.8 * max(size) * (1 + spread * rng.normal())
        K = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
        cameras.append(look_at(f"cam{index:02d}", *size, K, center, target, np.array([0, 0, 1.0])))
    return Rig(tuple(cameras))


def main() -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cameras", type=int, default=24)
    parser.add_argument("--size", default="1920x1080", metavar="WxH")
    parser.add_argument(
        "--spread", type=float, default=0.01, help="relative deviation of focal lengths (default %(default)s)"
    )
    parser.add_argument("--features", type=int, default=8192, help="maximum per camera (default %(default)s)")
    parser.add_argument("--save", type=Path, help="write the first camera's image to this file")
    options = parser.parse_args()
    width, _, height = options.size.partition("x")
    rng = np.random.default_rng(0)
    truth = ring(options.cameras, (int(width), int(height)), options.spread, rng)
    room, *pillars = [painted(number, rng) for number in range(len(PILLARS) + 1)]
    images = {camera.name: draw(camera, room, pillars, rng) for camera in truth}
    if options.save:
        cv2.imwrite(str(options.save), np.ascontiguousarray(next(iter(images.values()))[:, :, ::-1]))
    reached: list[tuple[int, float]] = []
    started = time.monotonic()

    def progress(done: int, total: int, **_: object) -> None:
        if not reached or done != reached[-1][0]:
            reached.append((done, time.monotonic() - started))
            print(f"\r{done:3d}% of {total}%, {reached[-1][1]:.0f} s", end="", flush=True)

    with tempfile.TemporaryDirectory() as work:
        result = calibrate_from_images(
            images,
            workdir=Path(work),
            settings=CalibrateSettings(max_features=options.features),
            reference=truth,
            progress=progress,
        )
    seconds = time.monotonic() - started
    difference = compare_rigs(result.rig, truth)
    radius = np.linalg.norm(truth.centers - truth.centers.mean(0), axis=1).mean()
    centers = 100 * np.array(list(difference.centers.values())) / radius
    at = {step: next((when for done, when in reached if done >= step), seconds) for step in (5, 25, 60, 90)}
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
    print(f"\r{len(result.rig)} of {options.cameras} cameras, {options.size}, {seconds:.0f} s: features "
          f"{at[25] - at[5]:.0f}, matches {at[60] - at[25]:.0f}, mapping {at[90] - at[60]:.0f}, adjustment "
          f"{seconds - at[90]:.0f}; peak memory of COLMAP's process {memory:.1f} GiB")  # fmt: skip
    print(f"  reprojection {result.report.reprojection.mean:.3f} px, match inlier ratio "
          f"{result.report.match_inlier_ratio:.2f}, sharing "
          f"{[(each.shared, each.misfit) for each in result.report.sharing]}")  # fmt: skip
    print(f"  center error in percent of the radius: mean {centers.mean():.4f}, maximum {centers.max():.4f}; maximum "
          f"rotation error {difference.rotation_degrees:.4f} degrees")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
