"""The first view of a stream."""

import numpy as np
import pytest

from studio.cameras import Camera, look_at_pose
from studio.stream.suggested_view import suggested_view

UP = np.array([0.0, 0.0, 2.0])
LOW, HIGH = (-0.5, -0.3, 0.0), (0.7, 0.4, 1.8)


def camera(eye, target=(0.0, 0.0, 0.5), size=(640, 360)):
    K = np.array([[900.0, 0, 300.0], [0, 900.0, 200.0], [0, 0, 1.0]])
    pose = look_at_pose(np.array(eye, float), np.array(target, float), np.array([0.1, 0.0, 1.0]))
    return Camera("front", *size, K, pose, (0.1, 0.0, 0.0, 0.0))


def edges(view):
    """Pixels of the middles of the box's edges."""
    points = [[x, y, 0.9] for x in (-0.5, 0.7) for y in (-0.3, 0.4)]
    points += [[x, 0.05, z] for x in (-0.5, 0.7) for z in (0.0, 1.8)]
    points += [[0.1, y, z] for y in (-0.3, 0.4) for z in (0.0, 1.8)]
    pixels, depths = view.project(np.array(points))
    assert (depths > 0).all()
    return pixels


@pytest.mark.parametrize("size", [(640, 360), (360, 640)])
def test_the_box_fills_the_picture_from_the_cameras_place(size):
    given = camera((3.0, -1.0, 1.2), size=size)
    view = suggested_view(given, LOW, HIGH, UP)
    np.testing.assert_allclose(view.center, given.center, atol=1e-9)
    assert (view.width, view.height) == size
    parts = edges(view) / size
    assert parts.min() > 0
    assert parts.max() < 1
    # One direction is full but for the margin, and what is up is up.
    assert np.ptp(parts, axis=0).max() > 0.85
    assert abs((view.rotation @ [0, 0, 1])[0]) < 1e-9
    assert (view.rotation @ [0, 0, 1])[1] < 0


@pytest.mark.parametrize("eye", [(0.1, 0.0, 0.9), (0.1, 0.05, 5.0)])
def test_inside_or_above_it_is_the_camera_itself(eye):
    given = camera(eye, target=(0.3, 0.2, 0.0))
    view = suggested_view(given, LOW, HIGH, UP)
    np.testing.assert_array_equal(view.world_to_camera, given.world_to_camera)
    assert len(view.distortion) == 0
