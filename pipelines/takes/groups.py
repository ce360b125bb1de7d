"""Groups of frames (section 4.1 of the paper): each has a keyframe in its middle.

Frames are trained outward from it, toward the end and toward the beginning: errors of motion add up over half as many
frames as from the first one, and the two sides do not need each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Group:
    """Consecutive frames that share one set of splats.

    Attributes:
        index: number of the group, counted from 0.
        first: index of its first frame, counted from 0 in the take.
    """

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
