"""Cameras, rigs, and intersections of rays."""

from __future__ import annotations

import numpy as np
import pytest

from studio.cameras import look_at_pose, nearest_point_to_rays
from tests.support.rigs import camera_at, ring

DISTORTIONS = {
    "pinhole": [],
    "radial": [-0.25, 0.08, 0.0, 0.0],
    "brown": [-0.2, 0.1, 0.001, 0.002, -0.03],
    "rational": [0.3, 0.05, 0.001, -0.001, 0.01, 0.5, 0.1, 0.02],
}


@pytest.mark.parametrize("kind", DISTORTIONS)
def test_unproject_inverts_project(kind: str) -> None:
    K = np.array([[150.0, 0, 84], [0, 160, 57], [0, 0, 1]])
    camera = camera_at("c", [2.0, -1.0, 0.7], [0.1, 0.2, 0.3], K=K, distortion=DISTORTIONS[kind])
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (40, 3))
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(camera.unproject(pixels, depth), points, atol=1e-8)
    rays = points - camera.center
    directions = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    np.testing.assert_allclose(camera.ray_directions(pixels), directions, atol=1e-8)
    at_one = camera.center + rays / depth[:, None]
    np.testing.assert_allclose(camera.unproject(pixels), at_one, atol=1e-8)


@pytest.mark.parametrize("kind", ["pinhole", "brown"])
def test_pixels_that_are_not_known_stay_unknown(kind: str) -> None:
    camera = camera_at("c", [2.0, 0, 0], distortion=DISTORTIONS[kind])
    pixels = np.array([[80.0, 60], [np.nan, np.nan]])
    found = camera.normalized(pixels)
    np.testing.assert_allclose(found[0], [0, 0], atol=1e-9)
    assert np.isnan(found[1]).all()
    assert camera.normalized(np.full((1, 2), np.nan)).shape == (1, 2)
    assert camera.unproject(np.zeros((0, 2))).shape == (0, 3)


def test_look_at() -> None:
    """From +x toward the origin with z up: right is +y, down is -z."""
    pose = look_at_pose(np.array([2.0, 0, 0]), np.zeros(3), np.array([0, 0, 5.0]))
    np.testing.assert_allclose(pose, [[0, 1, 0, 0], [0, 0, -1, 0], [-1, 0, 0, 2], [0, 0, 0, 1]], atol=1e-15)


def test_the_focus_of_a_ring_is_what_it_looks_at() -> None:
    rig = ring(5, heights=(0.3, 1.2), target=(1, 2, 3))
    np.testing.assert_allclose(rig.focus, [1, 2, 3], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(rig.centers[:, :2] - [1, 2], axis=1), 3)


def test_lines_through_a_point_meet_there() -> None:
    rng = np.random.default_rng(0)
    point, origins = rng.normal(size=3), rng.normal(size=(7, 3))
    directions = (point - origins) / np.linalg.norm(point - origins, axis=1, keepdims=True)
    np.testing.assert_allclose(nearest_point_to_rays(origins, directions), point, atol=1e-12)


def test_two_skew_lines() -> None:
    """The x axis and a line along y at height 3: the point is between them, closer to the line with more weight."""
    origins, directions = np.array([[5.0, 0, 0], [0.0, -2, 3]]), np.array([[1.0, 0, 0], [0, 1, 0]])
    np.testing.assert_allclose(nearest_point_to_rays(origins, directions), [0, 0, 1.5], atol=1e-12)
    weighted = nearest_point_to_rays(origins, directions, np.array([1.0, 2.0]))
    np.testing.assert_allclose(weighted, [0, 0, 2], atol=1e-12)


def test_parallel_lines_give_the_point_of_least_norm() -> None:
    origins, directions = np.array([[0.0, 0, 7], [2.0, 0, -4]]), np.array([[0.0, 0, 1], [0, 0, 1]])
    np.testing.assert_allclose(nearest_point_to_rays(origins, directions), [1, 0, 0], atol=1e-12)
