"""Splats far away from all others, as trainers without bounds leave them.

The positions of a stream have 16 bits over the box of the keyframe, so a single splat a kilometer away would cost a
body its precision. Splats farther than `_REACH` times the radius of the bulk are therefore moved toward the middle and
shrunk by the same factor: seen from the middle, nothing changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from v3studio.studio.gaussians import Gaussians

_OUTSIDE = 1000  # one splat of so many may be far away
_LEAST = 100  # fewer splats have no bulk
_REACH = 16.0  # cells of positions are then at most 1/2048 of the bulk's radius


@dataclass(frozen=True, eq=False)
class Spread:
    """Places of the splats of a frame: (3,) median of their positions, the distance within which all but 0.1% are, and
    the (0.1% of N,) distances of the others."""

    middle: np.ndarray
    radius: float
    farthest: np.ndarray

    @classmethod
    def of(cls, gaussians: Gaussians) -> Spread:
        """The spread of N splats, N at least 1, with finite positions."""
        means = gaussians.means.double().numpy()
        middle = np.median(means, axis=0)
        distances = np.sort(np.linalg.norm(means - middle, axis=1))
        inside = len(means) - (max(1, len(means) // _OUTSIDE) if len(means) >= _LEAST else 0)
        return cls(middle, float(distances[inside - 1]), distances[inside:].copy())


@dataclass(frozen=True, eq=False)
class Bulk:
    """The ball (middle, reach; world units) beyond which splats are outliers, how many most, and the farthest one."""

    middle: np.ndarray
    reach: float
    count: int = 0
    farthest: float = 0.0

    @classmethod
    def of(cls, spreads: Sequence[Spread]) -> Bulk:
        """The bulk of the frames of a sequence, at least one."""
        middle = np.median([spread.middle for spread in spreads], axis=0)
        apart = [float(np.linalg.norm(spread.middle - middle)) for spread in spreads]
        reach = _REACH * max(distance + spread.radius for distance, spread in zip(apart, spreads, strict=True))
        outliers = [spread.farthest[spread.farthest > reach] for spread in spreads]
        count = max(map(len, outliers))
        if not count or reach <= 0:
            return cls(middle, math.inf)
        return cls(middle, reach, count, float(max(distances.max(initial=0.0) for distances in outliers)))

    @property
    def note(self) -> str | None:
        """A sentence about what was done with the outliers; None if there are none."""
        if not self.count:
            return None
        return (
            f"up to {self.count} splats a frame are far away ({self.farthest:.3g} units from the middle): moved to a "
            f"distance of {self.reach:.3g} and shrunk as much, so that the others keep their precision"
        )

    def pulled_in(self, gaussians: Gaussians) -> Gaussians:
        """The splats, with outliers moved and shrunk."""
        if not self.count:
            return gaussians
        middle = torch.from_numpy(self.middle)
        offsets = gaussians.means.double() - middle
        factors = (self.reach / offsets.norm(dim=1, keepdim=True).clamp_min(1e-300)).clamp_max(1.0)
        moved = factors < 1
        return replace(
            gaussians,
            means=torch.where(moved, (middle + factors * offsets).float(), gaussians.means),
            log_scales=torch.where(moved, gaussians.log_scales + factors.log().float(), gaussians.log_scales),
        )
