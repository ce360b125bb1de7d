"""Shadows of colored lights, drawn with known factors on a textured floor, and dark performers that are no shadows."""

import cv2
import numpy as np
import pytest

from tests.studio.masks.scenes import disc, filmed, over, overlap
from v3studio.studio.masks.clean_plate import Background, DifferenceSettings, difference_mask

SHAPE = (240, 360)
ORANGE, BLUE = np.array([210.0, 100.0, 40.0]), np.array([60.0, 90.0, 160.0])
ON = DifferenceSettings(mask_shadows="colored")
COLORS = {
    "warm light gone": (0.6, 0.85, 0.9),
    "blue light gone": (0.88, 0.7, 0.45),
    "hard and dark": (0.33, 0.33, 0.33),
}


def floor(contrast: float = 0.06) -> np.ndarray:
    """(H, W, 3) saturated orange floor with fine texture, 0..255."""
    grain = cv2.GaussianBlur(np.random.default_rng(3).normal(0, 1, SHAPE), (0, 0), 1.5)
    return ORANGE * (1 + contrast * grain / grain.std())[..., None]


@pytest.mark.parametrize("color", list(COLORS))
def test_a_colored_shadow_is_not_the_performer(color: str) -> None:
    alpha, shadow = disc(SHAPE, 110, 110, 30, 60), disc(SHAPE, 220, 165, 90, 28)
    image = filmed(over(BLUE, alpha, over(floor() * COLORS[color], shadow, floor())), 2)
    plate = filmed(floor(), 1)
    assert overlap(difference_mask(image, Background(plate), ON), alpha) > 0.94
    for off in (DifferenceSettings(), DifferenceSettings(mask_shadows="none")):
        kept = difference_mask(image, Background(plate), off)
        assert overlap(kept, np.maximum(alpha, shadow)) > 0.9  # otherwise, it is


@pytest.mark.parametrize(("color", "contrast"), [*((color, 0.06) for color in COLORS), ("hard and dark", 0.0)])
def test_a_dark_performer_is_no_shadow(color: str, contrast: float) -> None:
    """Clothes with exactly the mean color of such a shadow, but without the texture of the floor."""
    alpha = disc(SHAPE, 150, 120, 45, 75)
    image = filmed(over(ORANGE * COLORS[color], alpha, floor(contrast)), 2)
    assert overlap(difference_mask(image, Background(filmed(floor(contrast), 1)), ON), alpha) > 0.94


@pytest.mark.parametrize("contrast", [0.1, 0.3])
@pytest.mark.parametrize("lighter", [0.0, 0.4], ids=["as dark", "lighter"])
@pytest.mark.parametrize("color", [*COLORS, "neutral"])
def test_a_shadow_in_view_takes_nothing_from_cloth_of_its_color(color: str, lighter: float, contrast: float) -> None:
    """Factors are the shadow's, or between them and 1, as at its edges; the texture around tells them apart."""
    factor = np.array(COLORS.get(color, (0.5, 0.5, 0.5)))
    alpha, shadow = disc(SHAPE, 110, 110, 40, 70), disc(SHAPE, 270, 150, 75, 60)
    shaded = over(floor(contrast) * factor, shadow, floor(contrast))
    image = filmed(over(ORANGE * (factor + lighter * (1 - factor)), alpha, shaded), 2)
    plate = filmed(floor(contrast), 1)
    without, mask = (difference_mask(image, Background(plate), settings) for settings in (DifferenceSettings(), ON))
    assert mask[alpha == 1].mean() > 0.95 * without[alpha == 1].mean() > 100
    assert mask[shadow == 1].mean() < 5
