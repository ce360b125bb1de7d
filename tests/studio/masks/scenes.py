"""Performers whose masks are known exactly, and how much of them a mask finds."""

import numpy as np

from v3studio.studio.cameras import Camera
from v3studio.studio.capture.settings import DifferenceSettings

USUAL = DifferenceSettings()


def disc(shape: tuple[int, int], x: float, y: float, across: float, down: float | None = None) -> np.ndarray:
    """A soft disc or ellipse, (H, W) in 0..1."""
    down = down or across
    rows, columns = np.mgrid[: shape[0], : shape[1]] + 0.5
    distance = np.hypot((columns - x) / across, (rows - y) / down)
    return np.clip((1 - distance) * min(across, down) + 0.5, 0, 1)


def ball(camera: Camera, center: np.ndarray, radius: float) -> np.ndarray:
    """(H, W) bool: which rays of the camera meet the ball."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    rays = camera.ray_directions(np.stack([columns.ravel(), rows.ravel()], 1))
    toward = center - camera.center
    away = np.linalg.norm(np.cross(rays, toward), axis=1)
    return ((away < radius) & (rays @ toward > 0)).reshape(rows.shape)


def filmed(image: np.ndarray, seed: int, noise: float = 2.5) -> np.ndarray:
    noisy = image + np.random.default_rng(seed).normal(0, noise, image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def over(front: np.ndarray, alpha: np.ndarray, behind: np.ndarray) -> np.ndarray:
    return alpha[..., None] * front + (1 - alpha[..., None]) * behind


def overlap(mask: np.ndarray, exact: np.ndarray) -> float:
    """Intersection over union of masks in 0..255, if they are uint8, or in 0..1."""
    ours, truth = (values > (127 if values.dtype == np.uint8 else 0.5) for values in (mask, exact))
    return float((ours & truth).sum() / max((ours | truth).sum(), 1))


def edge_error(mask: np.ndarray, alpha: np.ndarray) -> float:
    """Mean error along the soft edge, relative to that of the best hard mask."""
    edge = (alpha > 0.05) & (alpha < 0.95)
    return float(np.abs(mask / 255 - alpha)[edge].mean() / np.abs((alpha > 0.5) - alpha)[edge].mean())
