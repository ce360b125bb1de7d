"""Bad masks are outvoted.

After strict carving each mask is asked what it shows that the hull leaves unexplained. Space that only a tolerated few
cameras refuse, and that half of the others miss, is given back, carved by those other cameras alone. With good masks
nothing is unexplained and nothing changes.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection

import numpy as np
import torch

from studio.meshing.hull import Hull, Tick, no_tick
from studio.meshing.silhouettes import Silhouettes


def _without(shapes: Silhouettes, points: torch.Tensor, left_out: Collection[int], band: float) -> torch.Tensor:
    """(N,) signed distance to the hull of all cameras but some, cut off at +-band."""
    least = torch.full((len(points),), band)
    for index in range(len(shapes)):
        if index not in left_out:
            value, seen = shapes.distance(index, points)
            least = torch.where(seen, torch.minimum(least, value), least)
    return least.clamp_min(-band)


def restore(
    hull: Hull, tolerant: np.ndarray, shapes: Silhouettes, unexplained: list[np.ndarray], tick: Tick = no_tick
) -> Hull:
    """Give back what a few bad masks carved away.

    Args:
        hull: the strict hull.
        tolerant: (Z, Y, X) bool: voxels refused by no more cameras than may be outvoted.
        shapes: the silhouettes.
        unexplained: a camera each, (h, w) bool in the reduced image: foreground that the strict hull does not cover.
        tick: called often.

    Returns:
        the hull with those voxels back that half of the cameras which see and accept them leave unexplained, carved
        there by the other cameras alone.
    """
    flat = np.flatnonzero(tolerant.ravel() & (hull.field.ravel() <= 0))
    if len(flat) == 0:
        return hull
    points = torch.from_numpy(hull.points(flat).astype(np.float32))
    missing = torch.zeros(len(points), dtype=torch.int16)
    accepting = torch.zeros(len(points), dtype=torch.int16)
    refusing = torch.zeros((len(shapes), len(points)), dtype=torch.bool)
    for index, camera in enumerate(shapes.cameras):
        tick()
        value, seen = shapes.distance(index, points)
        pixels, _ = shapes.project(index, points)
        column = pixels[:, 0].clamp(0, camera.width - 1).long()
        row = pixels[:, 1].clamp(0, camera.height - 1).long()
        gap = torch.from_numpy(unexplained[index])[row, column]
        accepting += seen & (value > 0)
        refusing[index] = seen & (value <= 0)
        missing += seen & (value > 0) & gap
    # A part shows beside the body only from some directions: half of the accepting cameras miss it.
    back = (missing >= 2) & (missing * 2 >= accepting)
    if not back.any():
        return hull
    # Those cameras that refuse much of it are the bad ones there; all the others still carve.
    votes = refusing[:, back].sum(1)
    allowed = int(refusing.sum(0).max())
    worst = torch.argsort(votes, descending=True)[:allowed].tolist()
    bad = [index for index in worst if votes[index] > 0.2 * int(back.sum())]
    back &= _without(shapes, points, bad, hull.band) > 0
    if not back.any():
        return hull
    shape = hull.field.shape
    given = np.stack(np.unravel_index(flat[back.numpy()], shape))
    limit = np.array(shape)[:, None] - 2  # the border stays outside
    near = np.zeros(hull.field.size, bool)
    for offset in itertools.product(range(-2, 3), repeat=3):
        near[np.ravel_multi_index(tuple(np.clip(given + np.array(offset)[:, None], 1, limit)), shape)] = True
    rim = np.flatnonzero(near)
    rim_points = torch.from_numpy(hull.points(rim).astype(np.float32))
    merged = hull.field.copy()
    merged.ravel()[rim] = np.maximum(merged.ravel()[rim], _without(shapes, rim_points, bad, hull.band).numpy())
    outvoted = {
        shapes.names[index]: int(refusing[index, back].sum()) for index in bad if bool(refusing[index, back].any())
    }
    return Hull(merged, hull.origin, hull.voxel, hull.band, hull.min_views, int(back.sum()), outvoted)
