"""Groups of frames (section 4.1 of the paper): each has a keyframe in its middle.

Frames are trained outward from it, toward the end and toward the beginning: errors of motion add up over half as many
frames as from the first one, and the two sides do not need each other.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

FEWEST = 4  # number of frames that a group may have however the performer moves: keyframes take the most time and bytes

MOST_MOTION = 0.48
"""Longest path of the performer between a keyframe and its group's first or last frame, in sizes of the performer. In
walk16's 30 frames, which are best as one group, it is 0.31; in groups of 12 to 15 frames with fast limbs up to
0.44, and in twice as long ones, which are worse, 0.53 to 0.72."""


@dataclass(frozen=True)
class Group:
    """Consecutive frames that share one set of splats: their number, and their first frame in the take, from 0."""

    index: int
    first: int
    frames: tuple[int, ...]

    @property
    def indices(self) -> range:
        """Indices of its frames, counted from 0 in the take."""
        return range(self.first, self.first + len(self.frames))

    @property
    def middle(self) -> int:
        """Position of the keyframe in the group, counted from 0."""
        return len(self.frames) // 2

    @property
    def keyframe(self) -> int:
        """Frame number of the keyframe in the footage."""
        return self.frames[self.middle]

    @property
    def sides(self) -> tuple[range, range]:
        """Positions of the other frames in the order of training: those after the keyframe, and those before it."""
        return range(self.middle + 1, len(self.frames)), range(self.middle - 1, -1, -1)

    def trained_before(self, position: int) -> list[int]:
        """Up to three positions that are trained just before this one, on its side, the latest last."""
        step = 1 if position > self.middle else -1
        steps = min(3, abs(position - self.middle))
        return [position - step * number for number in range(steps, 0, -1)]


@lru_cache(maxsize=8)
def cut_into_groups(frames: tuple[int, ...], size: int, motion: tuple[float, ...] | None = None) -> tuple[Group, ...]:
    """Split frames into as few groups as possible, as even as possible: of `size` frames at most, with a path of at
    most `MOST_MOTION` between the keyframe and either end, or of at most `FEWEST` frames. `motion`: of the performer
    from each frame to the next, see `studio.footage.motion`; None: they do not move."""
    path = np.cumsum([0.0, *(motion or (0.0,) * (len(frames) - 1))])
    counts, unevenness, before = np.zeros(len(frames) + 1), np.zeros(len(frames) + 1), [0] * (len(frames) + 1)
    for end in range(1, len(frames) + 1):
        starts = np.arange(max(0, end - size), end)
        lengths = end - starts
        middles = starts + lengths // 2
        moved = np.maximum(path[middles] - path[starts], path[end - 1] - path[middles])
        count = np.where((moved <= MOST_MOTION) | (lengths <= FEWEST), counts[starts] + 1, np.inf)
        # frames count more than motion: two groups of 12 are better than one of 6 with the fast ones and one of 18
        whole = (path[end - 1] - path[starts]) / (2 * MOST_MOTION)
        uneven = unevenness[starts] + (lengths / size) ** 2 + (whole / 2) ** 2
        best = np.lexsort((-starts, uneven.round(9), count))[0]
        counts[end], unevenness[end], before[end] = count[best], uneven[best], int(starts[best])
    ends = [len(frames)]
    while ends[-1] > 0:
        ends.append(before[ends[-1]])
    borders = pairwise(reversed(ends))
    return tuple(Group(index, first, frames[first:end]) for index, (first, end) in enumerate(borders))
