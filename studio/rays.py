"""Intersection of rays in space."""

from __future__ import annotations

import numpy as np


def nearest_point_to_rays(origins: np.ndarray, directions: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """The point with the smallest sum of squared distances to lines in space.

    Lines are infinite in both directions. If they are parallel, so that the point is not unique, the one with the
    smallest norm is returned.

    Args:
        origins: (N, 3) a point on each line.
        directions: (N, 3) unit directions.
        weights: (N,) weights of the squared distances; None: all 1.

    Returns:
        (3,) float64.
    """
    projectors = np.eye(3)[None] - directions[:, :, None] * directions[:, None, :]
    if weights is not None:
        projectors = weights[:, None, None] * projectors
    matrix, right = projectors.sum(0), np.einsum("cij,cj->i", projectors, origins)
    point: np.ndarray = np.linalg.lstsq(matrix, right, rcond=1e-6)[0]
    return point
