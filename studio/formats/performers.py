"""Assigns splats to performers who stand apart from each other, for mattes.

At the first frame of each group, splats are connected over gaps that no body has; the parts are the performers. Within
a group, splats correspond. From group to group, a performer is who stands where one stood a frame before.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from v3studio.studio.edits.selection import connected_cells
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians

_GAPS = (0.1, 0.07, 0.05, 0.035)
"""Tried gaps between performers, relative to the size of all together. Smaller ones break bodies of few splats."""

_LEAST = 0.4  # least share of the splats of one of N performers, times N squared: among many, one may be a ball

_REST = 0.5
"""Most splats of any other part, relative to the smallest performer: floaters, which belong to the nearest one."""

_CELLS = 2.0  # cells of the grid by which splats are connected, in a gap
_VISIBLE = 0.1  # least opacity of a splat that connects others


def separated(splats: Gaussians, count: int) -> np.ndarray | None:
    """(N,) int: the performer of each splat, 0 to `count` - 1; None if there are not `count` that stand apart."""
    if count == 1:
        return np.zeros(len(splats), int)
    means = _finite_means(splats)
    solid = means[(splats.opacities > _VISIBLE).cpu().numpy()]
    if len(solid) == 0:
        return None
    low, high = np.quantile(solid, (0.02, 0.98), axis=0)
    for gap in _GAPS:
        size = max(gap * float(np.linalg.norm(high - low)) / _CELLS, 1e-12)
        cells = np.floor(solid / size)
        first, own, parts = connected_cells(cells, _CELLS)
        sizes = np.bincount(parts[own])
        ranked = np.argsort(-sizes, kind="stable")
        least, rest = sizes[ranked[:count]].min(), sizes[ranked[count:]].max(initial=0)
        if len(sizes) >= count and least >= _LEAST / count**2 * len(solid) and rest < _REST * least:
            large = np.sort(ranked[:count])
            kept = np.isin(parts, large)
            nearest = cKDTree(cells[first][kept] + 0.5).query(means / size)[1]
            return np.searchsorted(large, parts[kept][nearest])
    return None


class Performers:
    """Labels the splats of one group after the other. `count`: of the performers, at least 1."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.labels = np.zeros(0, int)
        """(N,) the performer of each splat of the group."""

    def enter(self, splats: Gaussians, before: Gaussians | None, number: int, order: Sequence[float]) -> None:
        """Go on to a group from `before`, the last frame of the group labeled last, if there is one.

        `number` of the first frame is for messages; `order`, (3,): direction along which performers are numbered
        without `before`.
        """
        parts = separated(splats, self.count)
        if parts is None:
            problem = f"frame {number} does not have {self.count} performers apart from each other"
            fix = "Choose frames in which they do not touch with --frames, or another number with --mattes."
            raise StudioError("exr.performers", problem, value=self.count, fix=fix)
        centers = self._centers(splats, parts)
        if before is None:
            names = np.argsort(np.argsort(centers @ np.asarray(order)))
        else:
            earlier = self._centers(before, self.labels)
            names = linear_sum_assignment(np.linalg.norm(centers[:, None] - earlier[None], axis=-1))[1]
        self.labels = names[parts]

    def _centers(self, splats: Gaussians, labels: np.ndarray) -> np.ndarray:
        means = _finite_means(splats)
        return np.stack([np.median(means[labels == performer], axis=0) for performer in range(self.count)])


def _finite_means(splats: Gaussians) -> np.ndarray:
    """(N, 3) float64."""
    return np.nan_to_num(splats.means.detach().cpu().double().numpy(), posinf=0, neginf=0)
