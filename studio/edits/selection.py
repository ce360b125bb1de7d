"""Selects the splats of a group that the edits remove.

A stream needs the same splats in all frames of a group, so each splat is kept or removed for the whole group: it is
removed by a box, a plane or a region if it is outside, below or inside in at least half of the group's frames for
which the edit holds. In the group in which a region was drawn, those inside in the frame on which it was drawn are.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from v3studio.studio.edits.edit_list import EditList, Floaters, Region
from v3studio.studio.gaussians import Gaussians

DISTANCE = 0.02  # default of `Floaters.distance`, of the diagonal of the performer's box

_SEEN = 0.05  # opacity of splats that span the performer's box
_STRAY = 0.01  # share of splats that may lie outside of that box, on each side of each axis


@dataclass(frozen=True, eq=False)
class Paths:
    """Positions of the splats of a group, (F, N, 3) in world units, and their opacities, (F, N), 0 to 1."""

    frames: Sequence[int]
    means: np.ndarray
    opacities: np.ndarray

    @classmethod
    def of(cls, numbers: Sequence[int], frames: Iterable[Gaussians]) -> Paths:
        """Collect the paths from frames that have the same splats and these numbers; `frames` is iterated once."""
        means, opacities = [], []
        for frame in frames:
            means.append(frame.means.detach().cpu().numpy())
            opacities.append(frame.opacities.detach().cpu().numpy().reshape(-1))
        return cls(tuple(numbers), np.stack(means), np.stack(opacities))


@dataclass(frozen=True, eq=False)
class Selection:
    """(N,) bool by kind of edit: the splats that it removes; "loose": in a small cluster, and not removed otherwise."""

    kinds: dict[str, np.ndarray]

    @property
    def removed(self) -> np.ndarray:
        """(N,) bool: what any edit removes."""
        any_kind: np.ndarray = np.any(list(self.kinds.values()), axis=0)
        return any_kind

    @property
    def counts(self) -> dict[str, int]:
        """Number of splats by kind; one splat may count for several."""
        return {name: int(selected.sum()) for name, selected in self.kinds.items()}


def select(edits: EditList, paths: Paths) -> Selection:
    """The splats of a group that the edits remove."""
    nothing = np.zeros(paths.means.shape[1], bool)
    crop = nothing if edits.crop is None else _mostly(~edits.crop.holds(paths.means))
    ground = nothing if edits.ground is None else _mostly(~edits.ground.holds(paths.means))
    regions = nothing
    for region in edits.regions:
        regions = regions | in_region(region, paths)
    faint = loose = nothing
    if edits.floaters is not None:
        if edits.floaters.opacity is not None:
            faint = paths.opacities.max(axis=0) < edits.floaters.opacity
        kept = np.flatnonzero(~(crop | ground | regions | faint))
        loose = nothing.copy()
        loose[kept] = _loose(edits.floaters, paths.means[0, kept], paths.opacities[0, kept])
    return Selection({"crop": crop, "ground": ground, "regions": regions, "faint": faint, "loose": loose})


def in_region(region: Region, paths: Paths) -> np.ndarray:
    """(N,) bool: the splats of a group that a region removes."""
    first, last = region.frames or (paths.frames[0], paths.frames[-1])
    frames = [at for at, number in enumerate(paths.frames) if first <= number <= last]
    if not frames:
        return np.zeros(paths.means.shape[1], bool)
    if region.drawn is not None and region.drawn in paths.frames:
        return _inside(region, paths.means[paths.frames.index(region.drawn)])
    return _mostly(np.stack([_inside(region, paths.means[at]) for at in frames]))


def _mostly(found: np.ndarray) -> np.ndarray:
    mostly: np.ndarray = 2 * found.sum(axis=0) >= len(found)
    return mostly


def _inside(region: Region, points: np.ndarray) -> np.ndarray:
    """(N,) whether points (N, 3) are in a region."""
    pixels, depth = region.view.camera.project(points)
    inside: np.ndarray = (depth > 0) & (depth >= region.near)
    if region.far is not None:
        inside &= depth <= region.far
    outline = np.array(region.outline)
    low, high = outline.min(axis=0) - (region.radius or 0), outline.max(axis=0) + (region.radius or 0)
    inside &= ((pixels >= low) & (pixels <= high)).all(axis=1)
    near = np.flatnonzero(inside)
    if region.radius is None:
        inside[near] = in_polygon(outline, pixels[near])
    else:
        inside[near] = distance_to_path(outline, pixels[near]) <= region.radius
    return inside


def in_polygon(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N,) whether points (N, 2) are inside a polygon (M, 2), by the even-odd rule."""
    inside = np.zeros(len(points), bool)
    x, y = points[:, 0], points[:, 1]
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if ay == by:
            continue
        crosses = (ay > y) != (by > y)
        inside ^= crosses & (x < ax + (y - ay) / (by - ay) * (bx - ax))
    return inside


def distance_to_path(path: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N,) distances of points (N, 2) to a path (M, 2) of straight pieces, or to its only point."""
    nearest = np.linalg.norm(points - path[0], axis=1)
    for start, end in pairwise(path):
        along = end - start
        share = np.clip((points - start) @ along / max(float(along @ along), 1e-12), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(points - start - share[:, None] * along, axis=1))
    return nearest


def cluster_distance(means: np.ndarray, opacities: np.ndarray) -> float:
    """`DISTANCE` times the diagonal of the box around visible splats, (N, 3) and (N,), without the few farthest out."""
    seen = means[opacities >= _SEEN]
    points = (seen if len(seen) else means).astype(np.float64)
    low, high = np.quantile(points, (_STRAY, 1 - _STRAY), axis=0)
    return max(DISTANCE * float(np.linalg.norm(high - low)), 1e-9)


def clusters(means: np.ndarray, distance: float) -> np.ndarray:
    """(N,) number of each splat's cluster, from means (N, 3) and the spacing of a grid in world units: splats in the
    same or in touching cells are in one cluster. So splats closer than the spacing always are, and ones farther apart
    than 3.5 times that are not neighbors."""
    if not len(means):
        return np.zeros(0, np.int64)
    cells = np.floor((means.astype(np.float64) - means.min(axis=0)) / distance)
    _, own, parts = connected_cells(cells, 1.8)  # the diagonal is 1.73
    own_parts: np.ndarray = parts[own]
    return own_parts


def connected_cells(cells: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Connect cells (N, 3) of a grid, whole numbers, with all cells up to `reach` away: (M,) indices of different ones;
    which of these each of the N is; and (M,) numbers of the parts that they form."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    near = np.minimum(cells - cells.min(axis=0), 2**20 - 1).astype(np.int64)  # farther ones count as one far cell
    _, first, own = np.unique(near @ np.array([2**42, 2**21, 1]), return_index=True, return_inverse=True)
    start, end = cKDTree(near[first]).query_pairs(reach, output_type="ndarray").T
    graph = coo_array((np.ones(len(start), bool), (start, end)), shape=(len(first), len(first)))
    return first, own.reshape(-1), connected_components(graph, directed=False)[1]


def _loose(floaters: Floaters, means: np.ndarray, opacities: np.ndarray) -> np.ndarray:
    """(N,) whether splats (N, 3) are in a cluster that is too small. The largest one always stays."""
    least = max(floaters.splats or 0, (floaters.share or 0) * len(means))
    if least == 0 or not len(means):
        return np.zeros(len(means), bool)
    numbers = clusters(means, floaters.distance or cluster_distance(means, opacities))
    sizes = np.bincount(numbers)
    small = sizes < least
    small[sizes.argmax()] = False
    loose: np.ndarray = small[numbers]
    return loose
