"""Where groups of frames are cut, and the order in which they are trained."""

import pytest

from pipelines.takes.groups import Group, cut_into_groups


@pytest.mark.parametrize(("frames", "order"), [(1, [0]), (2, [1, 0]), (3, [1, 2, 0]), (6, [3, 4, 5, 2, 1, 0])])
def test_frames_are_trained_from_the_middle_to_the_end_and_to_the_start(frames: int, order: list[int]) -> None:
    group = Group(index=0, first=0, frames=tuple(range(10, 10 + frames)))
    after, before = group.sides
    assert [group.middle, *after, *before] == order
    assert group.keyframe == group.frames[order[0]]


def test_a_frame_starts_from_those_between_it_and_the_keyframe() -> None:
    (group,) = cut_into_groups(tuple(range(100, 111)), 20)
    before = {position: group.trained_before(position) for position in range(11)}
    assert before[5] == []
    assert (before[6], before[7], before[10]) == ([5], [5, 6], [7, 8, 9])
    assert (before[4], before[3], before[0]) == ([5], [5, 4], [3, 2, 1])
