"""Coverage of rings and arcs of cameras, whose gaps are known."""

import json
import math

import numpy as np
import pytest

from tests.support.rigs import camera_at
from v3studio.studio.calibration.coverage import ViewRange, coverage, facing_cameras, view_range

UP = np.array([0.0, 0.0, 1.0])


def arc(count: int, degrees: float) -> list:
    """Cameras at equal distances on an arc of a horizontal circle; 360 is a full ring."""
    step = degrees / count if degrees == 360 else degrees / (count - 1)
    turns = [math.radians(index * step) for index in range(count)]
    return [camera_at(f"cam{n}", (3 * math.cos(a), 3 * math.sin(a), 0.0)) for n, a in enumerate(turns)]


def sphere(count: int = 2000) -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def test_a_ring_covers_all_around_but_not_the_top() -> None:
    found = view_range(arc(16, 360), (0, 0, 0))
    assert found.angle == 35, "neighbors are 22.5 degrees apart: the least"
    assert found.angle_from((5, 0, 0)) == pytest.approx(0, abs=1e-4)
    between = math.radians(11.25)
    assert found.angle_from((5 * math.cos(between), 5 * math.sin(between), 0)) == pytest.approx(11.25)
    assert found.angle_from((0, 0, 2)) == pytest.approx(90)
    measured = coverage(arc(16, 360), 0.5 * sphere(), sphere(), UP)
    assert measured.outside == 0
    # from 66 degrees of latitude on, where the normal is 75 degrees from a camera at six radii
    assert measured.unseen == pytest.approx(1 - math.sin(math.radians(66)), abs=0.02)


def test_a_surface_is_counted_by_the_cameras_that_face_it() -> None:
    cameras = arc(4, 360)
    points = np.array([[0.5, 0, 0], [0.35, 0.35, 0], [0, 0, 0.5]])
    assert facing_cameras(cameras, points, points).tolist() == [1, 2, 0]
    assert facing_cameras(cameras, points, -points).tolist() == [1, 2, 0], "from inside, those opposite"
    far = np.array([[0.0, 0, 50.0]])
    assert facing_cameras(cameras, far, np.array([[1.0, 0, 0]])).tolist() == [0], "outside of the pictures"


def test_it_is_written_and_read_and_what_is_malformed_is_none() -> None:
    found = view_range(arc(5, 120), (1, 2, 3))
    values = json.loads(json.dumps(found.to_json()))
    again = ViewRange.from_json(values)
    assert np.allclose(again.center, (1, 2, 3))
    assert np.allclose(again.directions, found.directions, atol=1e-4)
    assert again.angle == pytest.approx(found.angle, abs=0.01)
    malformed = {
        "angle": (0, math.nan), "center": (["a", 0, 0], [math.inf, 0, 0]),
        "directions": ([], [[0, 0, 0]], [[1, 0]], [[1, 0, 0]] * 257),
    }  # fmt: skip
    for name, wrong in malformed.items():
        assert [ViewRange.from_json({**values, name: value}) for value in wrong] == [None] * len(wrong), name
    assert ViewRange.from_json(None) is None
    assert view_range([], (0, 0, 0)) is None
    assert len(view_range(arc(300, 360), (0, 0, 0)).directions) <= 256
