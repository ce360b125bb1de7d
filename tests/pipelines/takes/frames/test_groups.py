from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from v3studio.pipelines.takes.frames import groups
from v3studio.pipelines.takes.frames.groups import FEWEST, MOST_MOTION, Group, cut_into_groups


def lengths(motion: list[float], size: int = 30) -> list[int]:
    return [len(group.frames) for group in cut_into_groups(tuple(range(len(motion) + 1)), size, tuple(motion))]


def test_every_frame_is_in_one_group() -> None:
    frames = tuple(range(10, 40, 3))
    cut = cut_into_groups(frames, 4, (0.2, 0.0, 0.9, 0.1, 0.1, 0.3, 0.0, 0.0, 0.2))
    assert sum((group.frames for group in cut), ()) == frames
    for number, group in enumerate(cut):
        assert (group.index, group.first) == (number, frames.index(group.frames[0]))


@pytest.mark.parametrize(
    ("count", "expected"), [(1, [1]), (30, [30]), (31, [16, 15]), (60, [30, 30]), (75, [25, 25, 25])]
)
def test_a_performer_who_stands_still_has_few_even_groups(count: int, expected: list[int]) -> None:
    assert lengths([0.0] * (count - 1)) == expected


def test_steady_motion_gives_groups_of_known_length() -> None:
    """2 k + 1 frames at a speed of v have a path of k v from the keyframe to each end."""
    speed = MOST_MOTION / 7.01
    assert lengths([speed] * 14) == [15]
    assert lengths([speed] * 15) == [8, 8]
    assert lengths([speed] * 44) == [15, 15, 15]
    assert lengths([speed / 2] * 44) == [23, 22]


def test_borders_are_where_the_motion_is() -> None:
    assert lengths([0.01] * 12 + [1.0] + [0.01] * 16) == [13, 17], "one jump"
    fast_end = lengths([0.01] * 15 + [0.08] * 14)
    assert fast_end[0] > fast_end[-1], "shorter where they move faster"


def test_groups_have_the_fewest_frames_however_the_performer_moves() -> None:
    assert lengths([9.0] * 11) == [FEWEST] * 3


def test_a_take_whose_ball_moves(project: Path, here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    take = project / "take"
    motion = take / "initialize" / "motion.json"

    def run(most_motion: float) -> list[int]:
        cut_into_groups.cache_clear()
        monkeypatch.setattr(groups, "FEWEST", 1)
        monkeypatch.setattr(groups, "MOST_MOTION", most_motion)
        here("run", project / "ball.yaml", "--take", take, "--train.group-size", 5, "--until", "train").ok()
        return [len(list(folder.glob("frame_*"))) for folder in sorted((take / "train").glob("group_*"))]

    assert run(0.05) == [3, 2]
    written = motion.stat().st_mtime_ns
    assert run(1.0) == [5]
    assert motion.stat().st_mtime_ns == written, "found once"
    cut_into_groups.cache_clear()


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
