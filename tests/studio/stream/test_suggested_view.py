"""The first view of a stream."""

import numpy as np
import pytest
import torch

from tests.support.splats import round_splats
from v3studio.studio.cameras import Camera, look_at_pose
from v3studio.studio.stream.suggested_view import eye_level_view, seen_box, suggested_view

UP = np.array([0.0, 0.0, 2.0])
LOW, HIGH = (-0.5, -0.3, 0.0), (0.7, 0.4, 1.8)


def camera(eye, target=(0.0, 0.0, 0.5), size=(640, 360)):
    K = np.array([[900.0, 0, 300.0], [0, 900.0, 200.0], [0, 0, 1.0]])
    pose = look_at_pose(np.array(eye, float), np.array(target, float), np.array([0.1, 0.0, 1.0]))
    return Camera("front", *size, K, pose, (0.1, 0.0, 0.0, 0.0))


def edges(view):
    """Places of the middles of the box's edges in the image, 0 to 1; all are in it."""
    points = [[x, y, 0.9] for x in (-0.5, 0.7) for y in (-0.3, 0.4)]
    points += [[x, 0.05, z] for x in (-0.5, 0.7) for z in (0.0, 1.8)]
    points += [[0.1, y, z] for y in (-0.3, 0.4) for z in (0.0, 1.8)]
    pixels, depths = view.project(np.array(points))
    assert (depths > 0).all()
    parts = pixels / (view.width, view.height)
    assert parts.min() > 0
    assert parts.max() < 1
    return parts


@pytest.mark.parametrize("size", [(640, 360), (360, 640)])
def test_the_box_fills_the_picture_from_the_cameras_place(size: tuple[int, int]) -> None:
    given = camera((3.0, -1.0, 1.2), size=size)
    view = suggested_view(given, LOW, HIGH, UP)
    np.testing.assert_allclose(view.center, given.center, atol=1e-9)
    assert (view.width, view.height) == size
    # One direction is full but for the margin, and what is up is up.
    assert np.ptp(edges(view), axis=0).max() > 0.85
    assert abs((view.rotation @ [0, 0, 1])[0]) < 1e-9
    assert (view.rotation @ [0, 0, 1])[1] < 0


@pytest.mark.parametrize("eye", [(0.1, 0.0, 0.9), (0.1, 0.05, 5.0)])
def test_inside_or_above_it_is_the_camera_itself(eye: tuple[float, float, float]) -> None:
    given = camera(eye, target=(0.3, 0.2, 0.0))
    view = suggested_view(given, LOW, HIGH, UP)
    np.testing.assert_array_equal(view.world_to_camera, given.world_to_camera)
    assert len(view.distortion) == 0


def test_where_nothing_can_be_seen_there_is_no_box() -> None:
    assert seen_box([round_splats(torch.zeros(5, 3), opacity=0.001)]) is None


def test_a_view_from_the_ceiling_is_lowered_to_eye_level() -> None:
    level = suggested_view(camera((3.0, -1.0, 1.2)), LOW, HIGH, UP)
    assert eye_level_view(level, LOW, HIGH, UP) is level
    high = suggested_view(camera((3.0, -1.0, 4.0)), LOW, HIGH, UP)
    view = eye_level_view(high, LOW, HIGH, UP)
    assert np.degrees(np.arcsin(-view.rotation[2, 2])) == pytest.approx(10)
    middle = (np.array(LOW) + HIGH) / 2
    assert np.linalg.norm(view.center - middle) == pytest.approx(np.linalg.norm(high.center - middle))
    assert edges(view).shape == (12, 2)
