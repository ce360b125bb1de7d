"""Evidence from a clean plate, in cases that can be computed by hand."""

import numpy as np
import pytest

from v3studio.studio.capture.settings import DifferenceSettings
from v3studio.studio.masks.clean_plate import difference_evidence, match_exposure

PLAIN = DifferenceSettings(mask_shadows="none")
BRIGHTER = 20.0
"""Difference of a patch in all channels: only luma differs, by as much."""


def evidence_on(plate: np.ndarray) -> float:
    """Evidence in the middle of a patch of 31 x 31 pixels of a (H, W) gray plate without noise."""
    height, width = plate.shape
    gray = np.repeat(plate[..., None], 3, axis=-1).astype(np.float32)
    image = gray.copy()
    image[height // 2 - 15 : height // 2 + 16, width // 2 - 15 : width // 2 + 16] += BRIGHTER
    return float(difference_evidence(image, gray, PLAIN)[height // 2, width // 2])


def expected(slope: float) -> float:
    """Standard deviations: 3 for what is always tolerated, 0.7 for noise, and 0.15 pixels of misregistration."""
    deviation = np.sqrt(3**2 + 0.7**2 + (0.15 * slope) ** 2)
    return float(1.2 * (BRIGHTER / deviation - 4))


@pytest.mark.parametrize("axis", [0, 1])
def test_slopes_of_the_plate_are_tolerated_in_both_directions(axis: int) -> None:
    flat = np.full((121, 161), 100.0)
    assert evidence_on(flat) == pytest.approx(expected(0), abs=0.01)
    # a ramp of 16 levels per pixel in the middle of the patch, where the slope is constant
    place = np.arange(flat.shape[axis]) - flat.shape[axis] // 2
    ramp = 100 + 16 * np.clip(place, -5, 5)
    plate = np.broadcast_to(ramp[:, None] if axis == 0 else ramp[None], flat.shape).copy()
    assert evidence_on(plate) == pytest.approx(expected(16), abs=0.01)
    assert expected(16) < expected(0) - 1


def test_exposure_is_the_median_ratio_of_usable_pixels() -> None:
    random = np.random.default_rng(3)
    plate = random.uniform(30, 150, (60, 80, 3)).astype(np.float32)
    image = plate * np.array([1.25, 0.8, 3.0], np.float32)
    image[:, :20] = 255  # the performer, a quarter
    plate[:, 20:30] = (10, 100, 100)  # a dark corner and an overexposed window tell nothing
    plate[:, 30:40] = (100, 250, 100)
    gain = match_exposure(image, plate)
    np.testing.assert_allclose(gain[:2], [1.25, 0.8], rtol=0.01)
    assert gain[2] == pytest.approx(1.4), "the limit"
    known = np.zeros((60, 80), bool)
    known[:5, 40:] = True  # too few
    assert match_exposure(image, plate, known).tolist() == [1, 1, 1]
    known[:, 60:] = True
    image[:, 40:60] = 0
    np.testing.assert_allclose(match_exposure(image, plate, known)[:2], [1.25, 0.8], rtol=0.01)
