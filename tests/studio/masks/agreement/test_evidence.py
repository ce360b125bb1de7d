"""Evidence of single images, on scenes with exact masks."""

import cv2
import numpy as np

from studio.capture.settings import DifferenceSettings
from studio.masks.agreement.evidence import LIMIT, evidence_of
from studio.masks.median_background import Background

WIDTH, HEIGHT = 240, 160


def empty_set() -> np.ndarray:
    texture = cv2.GaussianBlur(np.random.default_rng(5).normal(0, 60, (HEIGHT, WIDTH, 3)).astype(np.float32), (0, 0), 4)
    return np.clip(np.linspace(90, 150, HEIGHT)[:, None, None] + texture, 0, 255)


def disc(x: float) -> np.ndarray:
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    return np.hypot(columns - x, rows - 80) < 24


def filmed(x: float, seed: int) -> np.ndarray:
    image = np.where(disc(x)[..., None], np.array([200.0, 60.0, 50.0]), empty_set())
    return np.clip(image + np.random.default_rng(seed).normal(0, 2, image.shape), 0, 255).astype(np.uint8)


def test_the_performer_is_found_before_a_plate() -> None:
    behind = Background(empty_set().astype(np.uint8))
    odds = evidence_of(filmed(100, 1), [filmed(94, 2), filmed(106, 3)], behind, DifferenceSettings())
    ours, exact = odds > 0, disc(100)
    assert (ours & exact).sum() / (ours | exact).sum() > 0.85
    assert np.abs(odds).max() < LIMIT + 0.5
    assert odds[~cv2.dilate(exact.astype(np.uint8), np.ones((31, 31))).astype(bool)].mean() < -2


def test_a_performer_in_the_plate_who_moves_is_in_doubt_and_the_wall_is_not() -> None:
    """The plate shows the performer, too: only motion tells the difference."""
    plate = np.where(disc(100)[..., None], np.array([200.0, 60.0, 50.0]), empty_set()).astype(np.uint8)
    everywhere = np.ones(plate.shape[:2], bool)
    behind = Background(plate, known=everywhere)  # estimated
    odds = evidence_of(filmed(100, 1), [filmed(92, 2), filmed(108, 3)], behind, DifferenceSettings())
    rim = disc(100) & ~cv2.erode(disc(100).astype(np.uint8), np.ones((5, 5))).astype(bool)
    assert odds[rim].mean() > odds[:, :40].mean() + 2
