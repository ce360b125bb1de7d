"""Shadows of colored lights, drawn with known factors on a textured floor, and dark performers that are no shadows."""

import cv2
import numpy as np
import pytest

from studio.masks.clean_plate import DifferenceSettings, difference_mask

HEIGHT, WIDTH = 240, 360
NOISE = 2.5
ON = DifferenceSettings(mask_shadows="colored")
COLORS = {
    "warm light gone": (0.6, 0.85, 0.9),
    "blue light gone": (0.88, 0.7, 0.45),
    "hard and dark": (0.33, 0.33, 0.33),
}


def disc(x: float, y: float, across: float, down: float) -> np.ndarray:
    """(H, W) soft ellipse in 0..1."""
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    distance = np.hypot((columns - x) / across, (rows - y) / down)
    return np.clip((1 - distance) * min(across, down) + 0.5, 0, 1)


def floor(contrast: float = 0.06) -> np.ndarray:
    """(H, W, 3) saturated orange floor with fine texture, 0..255."""
    grain = cv2.GaussianBlur(np.random.default_rng(3).normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 1.5)
    return np.array([210.0, 100.0, 40.0]) * (1 + contrast * grain / grain.std())[..., None]


def filmed(picture: np.ndarray, seed: int) -> np.ndarray:
    noisy = picture + np.random.default_rng(seed).normal(0, NOISE, picture.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def overlap(mask: np.ndarray, exact: np.ndarray) -> float:
    ours, truth = mask > 127, exact > 0.5
    return float((ours & truth).sum() / (ours | truth).sum())


@pytest.mark.parametrize("color", list(COLORS))
def test_a_colored_shadow_is_not_the_performer(color: str) -> None:
    alpha, shadow = disc(110, 110, 30, 60), disc(220, 165, 90, 28)
    shaded = floor() * (1 - shadow[..., None] * (1 - np.array(COLORS[color])))
    image = shaded * (1 - alpha[..., None]) + np.array([60.0, 90.0, 160.0]) * alpha[..., None]
    plate = filmed(floor(), 1)
    assert overlap(difference_mask(filmed(image, 2), plate, ON), alpha) > 0.94
    for off in (DifferenceSettings(), DifferenceSettings(mask_shadows="none")):
        kept = difference_mask(filmed(image, 2), plate, off)
        assert overlap(kept, np.maximum(alpha, shadow)) > 0.9  # otherwise, it is


@pytest.mark.parametrize(("color", "contrast"), [*((color, 0.06) for color in COLORS), ("hard and dark", 0.0)])
def test_a_dark_performer_is_no_shadow(color: str, contrast: float) -> None:
    """Clothes with exactly the mean color of such a shadow, but without the texture of the floor."""
    alpha = disc(150, 120, 45, 75)
    cloth = np.array([210.0, 100.0, 40.0]) * COLORS[color]
    image = floor(contrast) * (1 - alpha[..., None]) + cloth * alpha[..., None]
    mask = difference_mask(filmed(image, 2), filmed(floor(contrast), 1), ON)
    assert overlap(mask, alpha) > 0.94


@pytest.mark.parametrize("contrast", [0.1, 0.3])
@pytest.mark.parametrize("lighter", [0.0, 0.4], ids=["as dark", "lighter"])
@pytest.mark.parametrize("color", [*COLORS, "neutral"])
def test_a_shadow_in_view_takes_nothing_from_cloth_of_its_color(color: str, lighter: float, contrast: float) -> None:
    """The same factors as the shadow's, or between them and 1, as at its edges; the texture around tells them apart."""
    factor = np.array(COLORS.get(color, (0.5, 0.5, 0.5)))
    alpha, shadow = disc(110, 110, 40, 70), disc(270, 150, 75, 60)
    shaded = floor(contrast) * (1 - shadow[..., None] * (1 - factor))
    cloth = np.array([210.0, 100.0, 40.0]) * (factor + lighter * (1 - factor))
    image = shaded * (1 - alpha[..., None]) + cloth * alpha[..., None]
    plate = filmed(floor(contrast), 1)
    without, mask = (difference_mask(filmed(image, 2), plate, one) for one in (DifferenceSettings(), ON))
    assert mask[alpha == 1].mean() > 0.95 * without[alpha == 1].mean() > 100
    assert mask[shadow == 1].mean() < 5
