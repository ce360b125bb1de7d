"""Masks to colored points: the start of training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from studio.meshing.coloring import color_points
from studio.meshing.hull import HullSettings
from studio.meshing.sampling import sample_surface
from studio.meshing.steps import part_of
from studio.meshing.surface import Mesh, MeshViews
from studio.meshing.visual_hull import visual_hull
from studio.progress import ProgressFn, no_progress
from studio.views import ViewLike

_DISAGREEMENT = 0.12
"""Masks that are right leave 0.01 to 0.05 (exact mattes, clean plates); 0.12 to 0.19 was measured where shadows were
taken for the performer, or only a median of the footage told him from the room."""


@dataclass
class InitResult:
    """What training starts from.

    Attributes:
        mesh: surface of the visual hull.
        points: (N, 3) float32 on it; normals (N, 3) float32 unit; colors (N, 3) float32 0..1.
        disagreement: a camera each, 0..1: 1 - IoU of the hull's silhouette and the mask; above about 0.12 the mask
            or the pose of that camera deserves a look.
        views_per_point: (N,) int: how many cameras saw each point.
        warnings: sentences for the user: cameras whose masks were outvoted or disagree.
    """

    mesh: Mesh
    points: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    disagreement: dict[str, float]
    views_per_point: np.ndarray
    warnings: list[str]


def initialize_points(
    views: Sequence[ViewLike],
    n_points: int = 50_000,
    *,
    settings: HullSettings | None = None,
    max_faces: int = 100_000,
    seed: int = 0,
    progress: ProgressFn = no_progress,
) -> InitResult:
    """Colored points on the visual hull of one moment.

    Args:
        views: pinhole views of the moment with image and matte.
        n_points: how many points to sample.
        settings: how to carve.
        max_faces: upper bound of the mesh's faces.
        seed: of the sampling; the same inputs and seed give the same points.
        progress: called often; may raise `Cancelled`.

    Returns:
        mesh, points, normals, colors and how far the cameras disagree.

    Raises:
        StudioError: see `visual_hull`.
    """
    result = visual_hull(views, settings, max_faces=max_faces, progress=part_of(progress, 0, 70))
    points, normals = sample_surface(result.mesh, n_points, seed=seed)
    colors, seen = color_points(
        points,
        normals,
        views,
        MeshViews(result.mesh),
        progress=part_of(progress, 70, 100),
    )
    warnings = [
        f"Camera '{name}': the hull's silhouette and its mask differ by {value:.0%}; look at its mask and pose."
        for name, value in result.disagreement.items()
        if value > _DISAGREEMENT
    ]
    warnings += [
        f"Camera '{name}': its mask misses {value:.1%} of the volume that the other cameras agree on; it was outvoted."
        for name, value in result.outvoted.items()
        if value > 0.002
    ]
    return InitResult(result.mesh, points, normals, colors, result.disagreement, seen, warnings)
