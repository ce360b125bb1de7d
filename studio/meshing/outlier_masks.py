"""Correction of outlier masks.

Strict carving leaves foreground of some masks uncovered by the hull if another mask is wrong. Space that at most the
tolerated number of cameras reject, and that is uncovered in half of the others, is restored and carved by those others
alone. If all masks are correct, no foreground is uncovered and the hull does not change.
"""

import itertools

import numpy as np
import torch

from v3studio.studio.meshing.hull import Hull, Tick
from v3studio.studio.meshing.silhouettes import Silhouette


def _field(shapes: list[Silhouette], points: torch.Tensor, band: float) -> torch.Tensor:
    """(N,) signed distance to the hull of these cameras, clamped to +-band."""
    least = torch.full((len(points),), band)
    for shape in shapes:
        value, seen = shape.distance(points)
        least = torch.where(seen, torch.minimum(least, value), least)
    return least.clamp_min(-band)


def restore(
    hull: Hull, tolerant: np.ndarray, shapes: list[Silhouette], uncovered: list[np.ndarray], tick: Tick
) -> Hull:
    """Restore the volume that outlier masks carved away; `hull` itself if there is none.

    The result includes the voxels that are uncovered in half of the cameras that see and accept them; these are carved
    without the outlier cameras. `tolerant`: (Z, Y, X) bool: voxels that at most the tolerated number of cameras reject;
    `uncovered`: one (h, w) bool per camera, in its reduced image: foreground that the strict hull does not cover.
    """
    flat = np.flatnonzero(tolerant.ravel() & (hull.field.ravel() <= 0))
    if len(flat) == 0:
        return hull
    points = torch.from_numpy(hull.points(flat).astype(np.float32))
    missing = torch.zeros(len(points), dtype=torch.int16)
    accepting = torch.zeros(len(points), dtype=torch.int16)
    rejecting = torch.zeros((len(shapes), len(points)), dtype=torch.bool)
    for index, shape in enumerate(shapes):
        tick()
        value, seen = shape.distance(points)
        pixels, _ = shape.project(points)
        column = pixels[:, 0].clamp(0, shape.camera.width - 1).long()
        row = pixels[:, 1].clamp(0, shape.camera.height - 1).long()
        gap = torch.from_numpy(uncovered[index])[row, column]
        accepting += seen & (value > 0)
        rejecting[index] = seen & (value <= 0)
        missing += seen & (value > 0) & gap
    # A limb is outside the body's silhouette only from some directions, so half of the accepting cameras suffice.
    back = (missing >= 2) & (missing * 2 >= accepting)
    if not back.any():
        return hull
    # The cameras that reject much of this space are the outliers there; all others still carve it.
    votes = rejecting[:, back].sum(1)
    allowed = int(rejecting.sum(0).max())
    worst = torch.argsort(votes, descending=True)[:allowed].tolist()
    bad = [index for index in worst if votes[index] > 0.2 * int(back.sum())]
    others = [shape for index, shape in enumerate(shapes) if index not in bad]
    back &= _field(others, points, hull.band) > 0
    if not back.any():
        return hull
    size = hull.field.shape
    restored = np.stack(np.unravel_index(flat[back.numpy()], size))
    limit = np.array(size)[:, None] - 2  # the border stays outside
    near = np.zeros(hull.field.size, bool)
    for offset in itertools.product(range(-2, 3), repeat=3):
        near[np.ravel_multi_index(tuple(np.clip(restored + np.array(offset)[:, None], 1, limit)), size)] = True
    rim = np.flatnonzero(near)
    rim_points = torch.from_numpy(hull.points(rim).astype(np.float32))
    merged = hull.field.copy()
    merged.ravel()[rim] = np.maximum(merged.ravel()[rim], _field(others, rim_points, hull.band).numpy())
    counts = {shapes[index].camera.name: int(rejecting[index, back].sum()) for index in bad}
    outliers = {name: count for name, count in counts.items() if count}
    return Hull(merged, hull.origin, hull.voxel, hull.band, hull.min_views, outliers)
