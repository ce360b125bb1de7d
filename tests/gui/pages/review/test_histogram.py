"""The histogram of opacities and the limit that is dragged in it."""

import numpy as np
import pytest

from gui.drawing.canvas import Canvas
from gui.drawing.palette import BLACK, FAIR, SECOND
from gui.pages.review.histogram import BINS, HistogramPlace, bars, draw_histogram

PLACE = HistogramPlace.of((960, 540), 16.0)


def test_bars_count_the_kept_splats() -> None:
    opacities = np.array([0.01, 0.011, 0.5, 0.99, 1.0, 0.3])
    counts = bars(opacities, np.array([True] * 5 + [False]))
    assert counts.sum() == 5
    assert (counts[0], counts[BINS // 2], counts[-1]) == (2, 1, 2)


@pytest.mark.parametrize("limit", [0.1, 0.25, 0.8])
def test_the_line_is_where_it_is_dragged_to(limit: float) -> None:
    x = PLACE.left + limit * PLACE.width
    assert PLACE.holds(x, PLACE.top + 5)
    assert PLACE.opacity_at(x) == pytest.approx(limit, abs=1e-3)
    canvas = Canvas(960, 540, BLACK)
    draw_histogram(canvas, PLACE, np.full(BINS, 7), limit, 99)
    row = canvas.pixels[round(PLACE.top + PLACE.height / 2)]
    below, above = (np.flatnonzero((row == color).all(axis=1)) for color in (FAIR, SECOND))
    assert below.max() <= x + 2
    assert above.min() >= x - PLACE.width / BINS
    assert not (canvas.pixels[: round(PLACE.top - 2 * PLACE.em)] != BLACK).any(), "covers no more than its corner"


def test_a_drag_beyond_the_ends_stays_a_limit() -> None:
    assert 0 < PLACE.opacity_at(-500) < PLACE.opacity_at(5000) == 1
    assert not PLACE.holds(900, 20)
