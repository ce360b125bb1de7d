"""The point nearest to lines in space."""

from __future__ import annotations

import numpy as np

from studio.rays import nearest_point_to_rays


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
