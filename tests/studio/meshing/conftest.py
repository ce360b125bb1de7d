"""Scenes whose silhouettes are known in closed form."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from tests.support.rigs import intrinsics, ring
from v3studio.studio.cameras import Camera, Rig


@dataclass
class Shot:
    """A view of a scene."""

    camera: Camera
    image: np.ndarray
    mask: np.ndarray

    def right_half(self) -> "Shot":
        """A shot as of a camera that sees only the right half."""
        left, camera = self.camera.width // 2, self.camera
        seen = camera.cropped(left, 0, camera.width - left, camera.height)
        return Shot(seen, self.image[:, left:], self.mask[:, left:])


def color_of(points: np.ndarray, middle: np.ndarray, radius: float) -> np.ndarray:
    """A color that changes smoothly over a ball, 0..1."""
    return 0.5 + 0.45 * np.clip((points - middle) / radius, -1, 1)


def shoot_balls(camera: Camera, balls: list[tuple[np.ndarray, float]]) -> Shot:
    """A view of ray-traced balls with an anti-aliased mask, colored by `color_of` of the first ball."""
    steps = (np.arange(3) + 0.5) / 3
    hits = np.zeros((camera.height, camera.width))
    image = np.zeros((camera.height, camera.width, 3))
    for dy in steps:
        for dx in steps:
            columns, rows = np.meshgrid(np.arange(camera.width) + dx, np.arange(camera.height) + dy)
            rays = camera.ray_directions(np.stack([columns, rows], -1).reshape(-1, 2)).reshape(*columns.shape, 3)
            nearest = np.full(columns.shape, np.inf)
            color = np.zeros((*columns.shape, 3))
            for middle, radius in balls:
                offset = middle - camera.center
                along = rays @ offset
                inside = radius**2 - (offset @ offset - along**2)
                distance = along - np.sqrt(np.maximum(inside, 0))
                hit = (inside > 0) & (along > 0) & (distance < nearest)
                nearest[hit] = distance[hit]
                color[hit] = color_of(camera.center + rays[hit] * distance[hit][:, None], *balls[0])
            hits += np.isfinite(nearest)
            image += color
    share = hits / 9
    rgb = np.divide(image, hits[..., None], out=np.zeros_like(image), where=hits[..., None] > 0)
    return Shot(camera, np.round(rgb * 255).astype(np.uint8), np.round(share * 255).astype(np.uint8))


def cameras_around(count: int, scale: float, origin: Sequence[float]) -> Rig:
    """Cameras around an origin at three heights, slightly rolled, with an off-center principal point."""
    return ring(
        count,
        radius=3 * scale,
        heights=[-1.5 * scale, 0.3 * scale, 1.8 * scale],
        target=origin,
        start=0.1,
        name="cam{:02d}",
        K=intrinsics(200.0, (160, 120), (3.0, -2.0)),
        up=(0.02, 0.03, 1.0),
    )


def two_balls(count: int, scale: float = 1.0, origin: Sequence[float] = (0, 0, 0)) -> list[Shot]:
    """A ball of radius 0.5 and a smaller one next to it, seen by a ring of cameras, at any scale and position."""
    cameras = cameras_around(count, scale, origin)
    return [replace(shot, camera=camera) for shot, camera in zip(_shots(count), cameras, strict=True)]


@cache
def _shots(count: int) -> list[Shot]:
    """Views of `two_balls`, which look the same at any scale and position."""
    balls = [(np.zeros(3), 0.5), (np.array([0.55, 0.1, 0.25]), 0.2)]
    return [shoot_balls(camera, balls) for camera in cameras_around(count, 1.0, (0, 0, 0))]


def distance_to_balls(points: np.ndarray, scale: float = 1.0, origin: Sequence[float] = (0, 0, 0)) -> np.ndarray:
    """Signed distance of points to the two balls, in units of `scale`; positive outside."""
    local = (points - np.array(origin)) / scale
    small = np.linalg.norm(local - np.array([0.55, 0.1, 0.25]), axis=1) - 0.2
    return np.minimum(np.linalg.norm(local, axis=1) - 0.5, small)
