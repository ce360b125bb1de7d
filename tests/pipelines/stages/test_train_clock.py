"""The clock's first guess against times that were measured (docs/measurements/training.md)."""

from typing import Any

import pytest

from pipelines.stages.train_group import TrainClock
from pipelines.takes.groups import Group
from studio.training.settings import TrainSettings


def time_of_frame(**values: Any) -> float:
    """Time of a later frame in that of a keyframe, before any was trained."""
    steps = {"keyframe_iterations": 2400, "prune_finetune_iterations": 800, "motion_iterations": 170}
    settings = TrainSettings().replace(**{**steps, "finetune_iterations": 250, "motion_views": 2, **values})
    group = Group(index=0, first=0, frames=(0, 1))
    clock = TrainClock([group], {0: set()}, settings)
    clock.reached((0, 1), "keyframe", 1.0)
    return 1 / clock.fraction - 1


def test_a_frame_of_the_quickstart_takes_14_seconds_where_its_keyframe_takes_78() -> None:
    assert time_of_frame() == pytest.approx(14 / 78, rel=0.1)


def test_motion_takes_longer_with_more_views() -> None:
    full = time_of_frame(finetune_iterations=0)
    # drawing two views takes 28 ms, their loss 5.5 ms, the network 12 ms
    assert time_of_frame(finetune_iterations=0, motion_views=4) / full == pytest.approx(
        (2 * 33.5 + 12) / 45.5, rel=0.05
    )


def test_joint_training_is_the_rest_of_the_group() -> None:
    settings = TrainSettings(keyframe_iterations=100, prune_finetune_iterations=0, motion_iterations=0,
                             finetune_iterations=50, joint_iterations=25)  # fmt: skip
    group = Group(index=0, first=0, frames=(0, 1))
    clock = TrainClock([group], {0: set()}, settings)
    clock.finished((0, 1), "keyframe", 10.0)
    clock.finished((0, 0), "later", 5.0)
    assert clock.fraction == pytest.approx(15 / 20)
    clock.reached((0, -1), "joint", 1.0)
    assert clock.fraction == pytest.approx(17.5 / 20)
    clock.finished((0, -1), "joint", 7.0, 2)
    assert clock.fraction == 1
