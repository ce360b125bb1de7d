"""Names beside what they name."""

import itertools

import numpy as np

from gui.drawing.canvas import Canvas
from gui.drawing.labels import draw_labels, place_labels
from gui.drawing.palette import GROUND


def square(x: float, y: float, side: float = 30) -> np.ndarray:
    return np.array([[x, y], [x + side, y], [x + side, y + side], [x, y + side]])


def test_names_cover_neither_each_other_nor_the_shapes_and_stay_inside() -> None:
    shapes = [square(100, 100), square(140, 100), square(100, 140), square(0, 0), square(370, 270)]
    places = place_labels(shapes, [(50, 16)] * len(shapes), (400, 300))
    found = [place for place in places if place is not None]
    assert len(found) == len(shapes)
    for (ax, ay), (bx, by) in itertools.combinations(found, 2):
        assert abs(ax - bx) >= 50 or abs(ay - by) >= 16
    for x, y in found:
        assert 0 <= x <= 350
        assert 0 <= y <= 284
        assert not any(
            (s[:, 0].min() < x + 50 and x < s[:, 0].max()) and (s[:, 1].min() < y + 16 and y < s[:, 1].max())
            for s in shapes
        )


def test_a_name_without_room_is_left_out_the_first_one_never() -> None:
    places = place_labels([square(100, 100)] * 9, [(50, 16)] * 9, (400, 300))
    assert places[0] is not None
    assert places.count(None) == 5, "below, above, right, left, and no room for more"


def test_what_is_far_outside_has_no_name() -> None:
    canvas = Canvas(200, 100)
    assert draw_labels(canvas, ["far", "here"], [square(9e5, -9e5), square(80, 20)], 12) == [False, True]
    assert (canvas.pixels[52:70, 60:130] != GROUND).any()
