"""Cutting a take into groups of frames (section 4.1 of the paper): each starts with a keyframe of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Group:
    """Frames that share splats.

    Attributes:
        index: 0, 1, 2 ...
        first: index in the take of its keyframe, counted from 0.
        frames: frame numbers as in the footage; the first is the keyframe.
    """

    index: int
    first: int
    frames: tuple[int, ...]

    @property
    def indices(self) -> range:
        """Indices of its frames in the take, counted from 0."""
        return range(self.first, self.first + len(self.frames))

    @property
    def keyframe(self) -> int:
        """Frame number of the keyframe, as in the footage."""
        return self.frames[0]


def cut_into_groups(frames: Sequence[int], size: int) -> tuple[Group, ...]:
    """Groups of `size` frames; the last one takes what is left."""
    return cut_at(frames, range(0, len(frames), size))


def cut_at(frames: Sequence[int], starts: Sequence[int]) -> tuple[Group, ...]:
    """Groups that begin at these indices, ascending, the first of them 0."""
    ends = [*starts[1:], len(frames)]
    return tuple(
        Group(index, first, tuple(frames[first:end]))
        for index, (first, end) in enumerate(zip(starts, ends, strict=True))
    )
