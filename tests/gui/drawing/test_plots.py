import numpy as np
import pytest

from v3studio.gui.drawing.canvas import Canvas
from v3studio.gui.drawing.palette import SECOND
from v3studio.gui.drawing.plots import curve

EM = 10.0


def test_values_are_drawn_to_scale() -> None:
    """Three points, of which the middle one is at a quarter of the range: its place is between those of the others."""
    canvas = Canvas(400, 200, (0, 0, 0))
    curve(canvas, (0, 0, 400, 200), "", [((0.0, 0.5, 1.0), (20.0, 25.0, 40.0))], EM, "", "")
    rows, columns = np.nonzero((canvas.pixels == SECOND).all(axis=2))
    left, right = columns.min(), columns.max()
    bottom = rows[columns <= left + 2].mean()
    top = rows[columns >= right - 3].mean()
    middle = rows[np.abs(columns - (left + right - 3) / 2) <= 1].mean()
    assert left == pytest.approx(3.6 * EM, abs=2)
    assert right == pytest.approx(399, abs=4)
    assert (bottom - middle) / (bottom - top) == pytest.approx(0.25, abs=0.03)
    # a twentieth of the range is left free above and below
    area = (1.6 * EM, 200 - 1.5 * round(0.82 * EM))
    assert area[0] + 5 < top < area[0] + 15
    assert area[1] - 15 < bottom < area[1] - 5
