"""Motion of a performer between two images, against displacements that are known."""

import cv2
import numpy as np
import pytest

from v3studio.studio.footage.motion import motion

HEIGHT, WIDTH = 240, 320
BLURRED = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8), (0, 0), 3)
TEXTURE = ((BLURRED - BLURRED.min()) * (255.0 / np.ptp(BLURRED))).astype(np.uint8)


def square(left: int, side: int = 80, noise: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A textured square before a gray wall, and its mask."""
    image, mask = np.full((HEIGHT, WIDTH, 3), 90.0), np.zeros((HEIGHT, WIDTH), np.uint8)
    at = slice(60, 60 + side), slice(left, left + side)
    image[at], mask[at] = TEXTURE[:side, :side], 255
    image += np.random.default_rng(noise).normal(0, 4 * (noise > 0), image.shape)
    return np.clip(image, 0, 255).astype(np.uint8), mask


def moved(before: tuple[np.ndarray, np.ndarray], after: tuple[np.ndarray, np.ndarray]) -> float | None:
    return motion((before[0], after[0]), (before[1], after[1]))


@pytest.mark.parametrize("pixels", [4, 8])
def test_a_square_moves_by_its_displacement_over_its_side(pixels: int) -> None:
    assert moved(square(100), square(100 + pixels)) == pytest.approx(pixels / 80, rel=0.12)
    assert moved(square(100, 160), square(100 + 2 * pixels, 160)) == pytest.approx(pixels / 80, rel=0.12)


def test_a_limb_counts_by_the_root_of_its_share() -> None:
    image, mask = square(100)
    still, wave = image.copy(), image.copy()
    still[100:120, 110:170] = TEXTURE[100:120, 200:260]
    wave[100:120, 116:176] = TEXTURE[100:120, 200:260]
    assert moved((still, mask), (wave, mask)) == pytest.approx(6 / 80 * (60 * 20 / 80**2) ** 0.5, rel=0.35)


def test_noise_of_a_static_scene_does_not_count() -> None:
    assert moved(square(100, noise=1), square(100, noise=2)) < 0.001


def test_what_moves_around_the_performer_does_not_count() -> None:
    before, after = square(100), square(100)
    before[0][20:50, 100:130] = 255
    after[0][20:50, 104:134] = 255
    assert moved(before, after) < 0.01


def test_what_appears_or_vanishes_counts_by_its_share() -> None:
    alone, both = square(100), square(100)
    both[1][60:84, 240:264] = 255
    for before, after in ((alone, both), (both, alone)):
        share = 24**2 / int((before[1] > 0).sum())
        assert moved(before, after) == pytest.approx(share, rel=0.1)


def test_a_performer_whom_the_camera_does_not_see() -> None:
    image, mask = square(100)
    nobody = image, np.zeros_like(mask)
    assert moved(nobody, nobody) is None
    assert moved(nobody, (image, mask)) == moved((image, mask), nobody) == 1
