"""Which lenses of a solution are fisheyes."""

from typing import Any

import numpy as np
import pytest

from v3studio.studio.calibration.initial_intrinsics import may_be_fisheye

pycolmap = pytest.importorskip("pycolmap")
from v3studio.studio.calibration.sfm.fisheyes import is_better, is_fisheye  # noqa: E402

BOW = [250.0, 250.0, 320.0, 240.0, 0.03, -0.01, 0.002, 0.0]


def solution(noise: float, count: int = 400) -> Any:
    """A model of one camera, a fisheye, and the points that it sees."""
    rng = np.random.default_rng(2)
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera(model="OPENCV_FISHEYE", width=640, height=480, params=BOW, camera_id=1)
    model.add_camera_with_trivial_rig(camera)
    image = pycolmap.Image(name="a", camera_id=1, image_id=1)
    local = np.column_stack([rng.uniform(-1.2, 1.2, count), rng.uniform(-0.9, 0.9, count), np.ones(count)])
    drawn = np.array(camera.img_from_cam(local)) + rng.normal(0, noise, (count, 2))
    image.points2D = pycolmap.Point2DList([pycolmap.Point2D(pixel) for pixel in drawn])
    model.add_image_with_trivial_frame(image, pycolmap.Rigid3d())
    for number, place in enumerate(local):
        track = pycolmap.Track()
        track.add_element(1, number)
        model.add_point3D(place, track, np.zeros(3, np.uint8))
    model.update_point_3d_errors()
    return model


def test_a_lens_is_a_fisheye_if_a_usual_one_does_not_fit() -> None:
    assert is_fisheye(solution(0.3), 1)
    assert not is_fisheye(solution(5.0), 1)  # so noisy that the lens does not matter


def test_a_solution_is_better_with_less_error() -> None:
    fine, rough = solution(0.2), solution(0.6)
    assert is_better(fine, rough)
    assert not is_better(rough, fine)
    assert not is_better(solution(0.2, 200), rough)  # has lost half of the observations


def test_long_lenses_and_straight_ones_are_none() -> None:
    assert may_be_fisheye(0.5, [-0.2])
    assert not may_be_fisheye(0.9, [-0.2])
    assert not may_be_fisheye(0.5, [0.01])
    assert not may_be_fisheye(0.5, [])
