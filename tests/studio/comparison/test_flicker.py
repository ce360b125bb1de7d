"""Flicker of views whose boxes differ."""

import numpy as np
import pytest

from v3studio.studio.comparison import Residual, flicker_of


def at(top: int, left: int, values: np.ndarray) -> Residual:
    return Residual((slice(top, top + len(values)), slice(left, left + values.shape[1])), values.astype(np.float16))


def test_only_pixels_of_both_boxes_count() -> None:
    image = np.zeros((20, 20, 3))
    image[5:10, 5:10] = 0.5
    before = {"a": at(0, 0, image[:10, :10]), "b": at(0, 0, image), "gone": at(0, 0, image)}
    same = {"a": at(5, 5, image[5:, 5:]), "b": at(0, 0, image)}
    assert flicker_of(before, same) == 0
    changed = {"a": at(5, 5, image[5:, 5:] + 0.25)}
    assert flicker_of(before, changed) == pytest.approx(0.25 * 255)
    assert flicker_of(before, same | changed) == pytest.approx(0.125 * 255)
