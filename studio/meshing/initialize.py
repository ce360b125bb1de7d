"""Colored points from masks, to initialize training."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from v3studio.studio.cameras import FootageView
from v3studio.studio.counts import short_repr
from v3studio.studio.errors import Message
from v3studio.studio.meshing.coloring import color_points
from v3studio.studio.meshing.settings import InitializeSettings
from v3studio.studio.meshing.surface import Mesh, MeshViews, sample_surface
from v3studio.studio.meshing.visual_hull import visual_hull
from v3studio.studio.progress import ProgressFn, no_progress, part_of

_DISAGREEMENT = 0.12
"""Disagreement above which a warning is given, if it is twice that of most cameras. Correct masks (exact masks, clean
plates) gave 0.01 to 0.05; masks with shadows classified as performer, or from a background estimated from the footage,
gave 0.12 to 0.19."""
_MIN_OUTLIER_SHARE = 0.002  # fraction of the hull rejected by an outlier mask above which a warning is given


@dataclass
class InitResult:
    """Initialization of one frame.

    Attributes:
        mesh: surface of the visual hull.
        points: (N, 3) float32 points on the surface.
        normals: (N, 3) float32 unit normals.
        colors: (N, 3) float32 in 0..1.
        disagreement: camera name to 1 - IoU of the hull's silhouette and the mask, 0..1. Ragged masks and small images
            raise it in all cameras.
        warnings: `hull.mask_mismatch` per camera whose disagreement is above 0.12 and more than twice the median, and
            `hull.outlier_mask` per camera whose mask was corrected, with the field `camera`.
    """

    mesh: Mesh
    points: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    disagreement: dict[str, float]
    warnings: list[Message]

    __repr__ = short_repr


def initialize_points(
    views: Sequence[FootageView],
    settings: InitializeSettings | None = None,
    *,
    seed: int = 0,
    progress: ProgressFn = no_progress,
) -> InitResult:
    """Colored points on the visual hull of one frame, from pinhole views with image and mask.

    The same inputs and seed give the same points. `progress` is called often and may raise `Cancelled`. StudioError:
    see `visual_hull`.
    """
    settings = settings or InitializeSettings()
    result = visual_hull(views, settings, progress=part_of(progress, 0, 70))
    points, normals = sample_surface(result.mesh, settings.points, seed=seed)
    colors = color_points(points, normals, views, MeshViews(result.mesh), progress=part_of(progress, 70, 100))
    usual = float(np.median(list(result.disagreement.values())))
    warnings = [
        Message(
            "hull.mask_mismatch",
            f"Camera '{name}': the hull's silhouette and the mask differ by {value:.0%}, usually by {usual:.0%}",
            value=value,
            fix="Check the mask and the camera pose.",
            fields={"camera": name},
        )
        for name, value in result.disagreement.items()
        if value > max(_DISAGREEMENT, 2 * usual)
    ]
    warnings += [
        Message(
            "hull.outlier_mask",
            f"Camera '{name}': the mask misses {value:.1%} of the volume that the other cameras agree on; it was "
            "ignored there",
            value=value,
            fields={"camera": name},
        )
        for name, value in result.outlier_shares.items()
        if value > _MIN_OUTLIER_SHARE
    ]
    return InitResult(result.mesh, points, normals, colors, result.disagreement, warnings)
