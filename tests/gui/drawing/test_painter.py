"""Points, lines and pictures in 3D: against the pinhole formula."""

import numpy as np
import pytest

from gui.drawing.canvas import Canvas
from gui.drawing.painter import draw_points, draw_quad, frustum
from studio.cameras import Camera

K = np.array([[50.0, 0, 40], [0, 50.0, 30], [0, 0, 1]])
CAMERA = Camera("a", 80, 60, K, np.eye(4))
BLACK = (40, 40, 40)


@pytest.mark.parametrize("opacity", [1.0, 0.5])
def test_a_picture_covers_its_corners_with_its_opacity(opacity: float) -> None:
    """A quad at a depth of 2: x from -0.8 to 0.4 is columns 20 to 50, y from -0.4 to 0.4 is rows 20 to 40."""
    canvas = Canvas(80, 60, BLACK)
    corners = np.array([[-0.8, -0.4, 2], [0.4, -0.4, 2], [0.4, 0.4, 2], [-0.8, 0.4, 2]])
    picture = np.zeros((20, 30, 3), np.uint8)
    picture[:, :15], picture[:, 15:] = (200, 0, 0), (0, 0, 200)
    draw_quad(canvas, CAMERA, corners, picture, opacity)
    for column, color in ((24, (200, 0, 0)), (46, (0, 0, 200))):
        expected = np.array(BLACK) * (1 - opacity) + np.array(color) * opacity
        np.testing.assert_allclose(canvas.pixels[30, column], expected, atol=1)
    changed = (canvas.pixels != BLACK).any(axis=2)
    assert not changed[:, :19].any()
    assert not changed[:, 52:].any()
    assert not changed[:19].any()
    assert not changed[42:].any()
    assert changed[22:38, 22:48].all()


def test_a_picture_with_a_corner_behind_the_camera_is_not_drawn() -> None:
    canvas = Canvas(80, 60, BLACK)
    corners = np.array([[-0.8, -0.4, 2], [0.4, -0.4, -1], [0.4, 0.4, 2], [-0.8, 0.4, 2]])
    draw_quad(canvas, CAMERA, corners, np.full((4, 4, 3), 255, np.uint8))
    assert (canvas.pixels == BLACK).all()


def test_nearer_points_are_in_front() -> None:
    canvas = Canvas(80, 60, BLACK)
    points = np.array([[0, 0, 1.0], [0, 0, 2.0], [0.4, 0.2, 2.0], [0, 0, -1.0], [9.0, 0, 1.0]])
    colors = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9], [9, 9, 9]], np.uint8)
    draw_points(canvas, CAMERA, points, colors, radius=2)
    expected = np.full((60, 80, 3), BLACK, np.uint8)
    expected[34:37, 49:52] = (0, 0, 255)  # 40 + 50 * 0.4 / 2 = 50, 30 + 50 * 0.2 / 2 = 35
    expected[29:32, 39:42] = (255, 0, 0)
    assert np.array_equal(canvas.pixels, expected)


def test_a_frustum_ends_at_the_corners_of_the_image() -> None:
    center, corners = frustum(CAMERA, 3.0)
    np.testing.assert_allclose(center, 0, atol=1e-12)
    np.testing.assert_allclose(corners[:, 2], 3)
    np.testing.assert_allclose(
        corners @ K.T / corners[:, 2:], [[0, 0, 1], [80, 0, 1], [80, 60, 1], [0, 60, 1]], atol=1e-9
    )
