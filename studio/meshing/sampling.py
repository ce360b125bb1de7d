"""Evenly distributed random points on a mesh, reproducible for a given seed."""

from __future__ import annotations

import numpy as np

from studio.errors import StudioError
from studio.meshing.surface import Mesh


def sample_surface(mesh: Mesh, count: int, *, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Sample points by area.

    The total area is divided into `count` equal parts along the list of faces, and one point is drawn from each part
    (stratified sampling). This distributes points more evenly than independent draws, without a neighbor search.

    Args:
        mesh: the surface.
        count: number of points, at least 1.
        seed: the same seed gives the same points.

    Returns:
        points (count, 3) float32, and unit normals (count, 3) float32 interpolated between the vertices.

    Raises:
        StudioError: `mesh.point_count`: `count` is below 1; `mesh.no_area`.
    """
    if count < 1:
        raise StudioError(
            "mesh.point_count", f"The number of points is {count}", value=count, fix="It must be at least 1."
        )
    total = np.cumsum(mesh.areas)
    if len(total) == 0 or not total[-1] > 0:
        raise StudioError(
            "mesh.no_area", "The mesh has no area to sample points from", fix="Check the masks and the camera poses."
        )
    random = np.random.default_rng(seed)
    place = (np.arange(count) + random.random(count)) / count * total[-1]
    face = np.minimum(np.searchsorted(total, place, side="right"), len(total) - 1)
    root, second = np.sqrt(random.random(count)), random.random(count)
    weights = np.stack([1 - root, root * (1 - second), root * second], 1)  # uniform in a triangle
    points = (mesh.corners[face] * weights[:, :, None]).sum(1)
    normals = (mesh.vertex_normals[mesh.faces[face]] * weights[:, :, None]).sum(1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return points.astype(np.float32), normals.astype(np.float32)
