"""Scenes whose silhouettes are known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from studio.cameras import Camera


@dataclass
class Shot:
    """A view to mesh from."""

    camera: Camera
    image: np.ndarray
    matte: np.ndarray


def look_at(name: str, center: np.ndarray, target: np.ndarray, focal: float, size: tuple[int, int]) -> Camera:
    """A camera at `center` that looks at `target`, z up."""
    forward = (target - center) / np.linalg.norm(target - center)
    right = np.cross(forward, [0.02, 0.03, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ center
    width, height = size
    K = np.array([[focal, 0, width / 2 + 3.0], [0, focal, height / 2 - 2.0], [0, 0, 1]])
    return Camera(name, width, height, K, pose)


def color_of(points: np.ndarray, middle: np.ndarray, radius: float) -> np.ndarray:
    """A color that changes smoothly over a ball, 0..1."""
    return 0.5 + 0.45 * np.clip((points - middle) / radius, -1, 1)


def shoot_balls(camera: Camera, balls: list[tuple[np.ndarray, float]], samples: int = 3) -> Shot:
    """Ray-traced balls with anti-aliased mattes; the first ball's colors are `color_of`."""
    steps = (np.arange(samples) + 0.5) / samples
    hits = np.zeros((camera.height, camera.width))
    image = np.zeros((camera.height, camera.width, 3))
    for dy in steps:
        for dx in steps:
            columns, rows = np.meshgrid(np.arange(camera.width) + dx, np.arange(camera.height) + dy)
            rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(camera.K).T @ camera.rotation
            rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
            nearest = np.full(columns.shape, np.inf)
            color = np.zeros((*columns.shape, 3))
            for middle, radius in balls:
                offset = middle - camera.center
                along = rays @ offset
                inside = radius**2 - (offset @ offset - along**2)
                distance = along - np.sqrt(np.maximum(inside, 0))
                hit = (inside > 0) & (along > 0) & (distance < nearest)
                nearest[hit] = distance[hit]
                points = camera.center + rays[hit] * distance[hit][:, None]
                color[hit] = color_of(points, *balls[0])
            hits += np.isfinite(nearest)
            image += color
    share = hits / samples**2
    rgb = np.divide(image, hits[..., None], out=np.zeros_like(image), where=hits[..., None] > 0)
    return Shot(camera, np.round(rgb * 255).astype(np.uint8), np.round(share * 255).astype(np.uint8))


def ring(count: int, scale: float = 1.0, origin: tuple[float, float, float] = (0, 0, 0)) -> list[Camera]:
    """Cameras about an origin, at three heights."""
    cameras = []
    middle = np.array(origin)
    for index in range(count):
        angle = 2 * np.pi * index / count + 0.1
        center = middle + scale * np.array([3 * np.cos(angle), 3 * np.sin(angle), (-1.5, 0.3, 1.8)[index % 3]])
        cameras.append(look_at(f"cam{index:02d}", center, middle, 200.0, (160, 120)))
    return cameras


@pytest.fixture(scope="session")
def two_balls() -> Callable[..., list[Shot]]:
    """A ball of radius 0.5 with a smaller one beside it, from a ring of cameras, at any scale and place."""

    def make(count: int = 12, scale: float = 1.0, origin: tuple[float, float, float] = (0, 0, 0)) -> list[Shot]:
        middle = np.array(origin)
        balls = [(middle, 0.5 * scale), (middle + scale * np.array([0.55, 0.1, 0.25]), 0.2 * scale)]
        return [shoot_balls(camera, balls) for camera in ring(count, scale, origin)]

    return make


def distance_to_balls(
    points: np.ndarray, scale: float = 1.0, origin: tuple[float, float, float] = (0, 0, 0)
) -> np.ndarray:
    """Signed distance of points to the two balls, in units of `scale`; positive outside."""
    local = (points - np.array(origin)) / scale
    big = np.linalg.norm(local, axis=1) - 0.5
    small = np.linalg.norm(local - np.array([0.55, 0.1, 0.25]), axis=1) - 0.2
    return np.minimum(big, small)


@pytest.fixture(scope="session")
def scenes() -> SimpleNamespace:
    """The helpers above, for tests (test folders are no packages that could be imported from)."""
    return SimpleNamespace(Shot=Shot, look_at=look_at, color_of=color_of, distance_to_balls=distance_to_balls)
