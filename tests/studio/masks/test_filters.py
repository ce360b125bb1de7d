"""Filters of the mask sources against their definitions, on small arrays."""

import numpy as np
import pytest

from v3studio.studio.masks.filters import color_bins, color_table, guided_filter, keep_components, odds_of_colors


def test_the_guided_filter_is_that_of_its_paper() -> None:
    """Algorithm 1 of He et al. 2010, pixel by pixel: mean over all windows of the line fitted in each."""
    random = np.random.default_rng(1)
    guide = random.uniform(0, 1, (12, 14)).astype(np.float32)
    values = random.normal(0, 2, (12, 14)).astype(np.float32)
    radius, epsilon = 2, 4e-4

    def line(row: int, column: int) -> tuple[float, float]:
        window = np.s_[row - radius : row + radius + 1, column - radius : column + radius + 1]
        near, seen = guide[window].astype(float).ravel(), values[window].astype(float).ravel()
        slope = np.cov(near, seen, ddof=0)[0, 1] / (near.var() + epsilon)
        return slope, seen.mean() - slope * near.mean()

    smooth = guided_filter(guide, values, radius)
    for row, column in ((4, 4), (5, 9), (7, 7)):
        around = [line(row - radius + y, column - radius + x) for y, x in np.ndindex(2 * radius + 1, 2 * radius + 1)]
        slope, offset = np.mean(around, axis=0)
        assert smooth[row, column] == pytest.approx(slope * guide[row, column] + offset, abs=1e-4)


def test_a_color_table_is_the_log_ratio_of_two_smoothed_histograms() -> None:
    front = np.full((30, 3), 72, np.uint8)  # bin 4 of each channel
    back = np.full((7, 3), 200, np.uint8)  # bin 12
    table = color_table(color_bins(front, 16), color_bins(back, 16), 16, floor=1e-3)
    taps = np.exp(-(np.arange(-2, 3) ** 2) / (2 * 0.8**2))
    middle, next_, _ = (taps / taps.sum())[2:]
    expected = {
        (4, 4, 4): np.log((middle**3 + 1e-3) / 1e-3),
        (4, 5, 4): np.log((next_ * middle**2 + 1e-3) / 1e-3),
        (3, 4, 5): np.log((next_**2 * middle + 1e-3) / 1e-3),
        (12, 12, 12): -np.log((middle**3 + 1e-3) / 1e-3),
        (8, 8, 8): 0.0,
    }
    for place, value in expected.items():
        assert table[place] == pytest.approx(value, abs=1e-3), place
    image = np.array([[[72, 72, 72], [200, 200, 200]]], np.uint8)
    assert odds_of_colors(table, image, 99, 1).tolist() == [[table[4, 4, 4], table[12, 12, 12]]]
    first, second = np.clip([table[4, 4, 4], table[12, 12, 12]], -2, 2)
    assert odds_of_colors(table, image, 2, 3)[0, 0] == pytest.approx((first + 2 * second) / 3)  # mirrored at the border


def scene() -> np.ndarray:
    """Areas 1600, 100, 25 and 9; the largest has holes of 36 and 4 pixels."""
    mask = np.zeros((80, 80), np.uint8)
    mask[5:45, 5:45] = 1
    mask[60:70, 5:15] = 1
    mask[60:65, 30:35] = 1
    mask[60:63, 50:53] = 1
    mask[10:16, 10:16] = 0
    mask[30:32, 30:32] = 0
    mask[5:7, 5:7] = 1
    return mask


@pytest.mark.parametrize(
    ("components", "minimum", "kept", "holes"),
    [
        (0, 1, (True, True, False), 2),  # 9 pixels are less than 1% of the largest component
        (0, 5, (True, True, False), 1),
        (0, 26, (True, False, False), 1),
        (0, 37, (True, False, False), 0),
        (1, 5, (False, False, False), 1),
        (2, 5, (True, False, False), 1),
    ],
)
def test_small_components_and_holes_go(components: int, minimum: int, kept: tuple[bool, ...], holes: int) -> None:
    result = keep_components(scene(), components, minimum)
    assert result[20, 20] == 1
    assert (bool(result[65, 10]), bool(result[62, 32]), bool(result[61, 51])) == kept
    assert int(not result[12, 12]) + int(not result[31, 31]) == holes
    assert result.dtype == np.uint8


def test_components_without_a_core_or_unlike_the_largest_go() -> None:
    core = np.zeros((80, 80), bool)
    core[20:22, 20:22] = core[65, 5:15] = core[61:63, 31:33] = True  # a line holds no 2 x 2 pixels
    result = keep_components(scene(), 0, 5, core)
    assert (result[20, 20], result[65, 10], result[62, 32]) == (1, 0, 1)
    likeness = np.full((80, 80), 2.0, np.float32)
    likeness[60:70, 5:15], likeness[60:65, 30:35] = 1.1, 0.9
    result = keep_components(scene(), 0, 5, None, likeness)
    assert (result[20, 20], result[65, 10], result[62, 32]) == (1, 1, 0)
