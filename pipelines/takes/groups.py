"""Groups of frames (section 4.1 of the paper): each begins with its own keyframe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Group:
    """Consecutive frames that share one set of splats.

    Attributes:
        index: number of the group, counted from 0.
        first: index of its keyframe, counted from 0 in the take.
        frames: frame numbers in the footage; the first is the keyframe.
    """

    index: int
    first: int
    frames: tuple[int, ...]

    @property
    def indices(self) -> range:
        """Indices of its frames, counted from 0 in the take."""
        return range(self.first, self.first + len(self.frames))

    @property
    def keyframe(self) -> int:
        """Frame number of the keyframe in the footage."""
        return self.frames[0]


def cut_into_groups(frames: Sequence[int], size: int) -> tuple[Group, ...]:
    """Split frames into groups of `size`; the last group may be shorter."""
    return cut_at(frames, range(0, len(frames), size))


def cut_at(frames: Sequence[int], starts: Sequence[int]) -> tuple[Group, ...]:
    """Split frames into groups that begin at the indices `starts`: ascending, the first is 0."""
    ends = [*starts[1:], len(frames)]
    return tuple(
        Group(index, first, tuple(frames[first:end]))
        for index, (first, end) in enumerate(zip(starts, ends, strict=True))
    )
