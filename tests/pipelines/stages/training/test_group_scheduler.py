import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.support.errors import refuses
from tests.support.events import frames_in
from tests.support.tiny_capture import run_take, settings_in
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.stages.training import group_scheduler
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError


def test_all_threads_are_shared_out() -> None:
    assert group_scheduler.threads_by_group(3, 1, 2) == [2, 2, 2]
    assert group_scheduler.threads_by_group(3, 2, 2) == [1, 1, 2]
    assert group_scheduler.threads_by_group(4, 2, 2) == [1, 1, 1, 1]
    assert group_scheduler.threads_by_group(5, 4, 16) == [4, 4, 4, 4, 16]
    assert group_scheduler.threads_by_group(2, 2, 1) == [1, 1]
    assert group_scheduler.threads_by_group(0, 1, 2) == []


def planned(asked: int | None = None) -> Any:
    """A context of eight groups on a CPU with eight threads: ten cameras of 4 megapixels."""
    cameras = {f"cam{number}": SimpleNamespace(width=2000, height=2000) for number in range(10)}
    run, train = SimpleNamespace(groups_at_once=asked, device="cpu"), SimpleNamespace(joint_iterations=0)
    config, groups = SimpleNamespace(run=run, train=train), [SimpleNamespace(frames=range(3))] * 8
    footage = SimpleNamespace(rig=cameras, train_cameras=list(cameras))
    return SimpleNamespace(config=config, device="cpu", threads=8, groups=groups, calibrated_footage=footage)


def test_both_sides_of_a_keyframe_need_threads_and_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    one = group_scheduler.memory_of_group(planned())
    found = []
    for groups, times in ((1, 1.9), (1, 2.1), (2, 3.9), (2, 4.1)):
        monkeypatch.setattr(group_scheduler, "memory_limit", lambda times=times: int(times * one))
        found.append([group_scheduler.sides_at_once(planned(asked=groups), threads) for threads in (1, 2, 4)])
    assert found == [[1, 1, 1], [1, 2, 2], [1, 1, 1], [1, 2, 2]]


def test_both_sides_of_a_keyframe_at_once_give_the_same_frames_again(project: Path) -> None:
    settings = ("run.threads=2", "train.group_size=5", "train.keyframe_iterations=10")
    take = Take(project / "take")

    def trained() -> tuple[list[int], list[bytes]]:
        events = run_take(project, *settings, stages=("calibrate", "initialize", "train"))
        return frames_in(events), [take.trained_frame(0, index).read_bytes() for index in range(5)]

    order, frames = trained()
    assert order[0] == 2
    take.trained_frame(0, 1).unlink()
    take.trained_frame(0, 4).unlink()
    order, again = trained()
    assert again == frames
    assert sorted(order) == [0, 1, 4]


def test_a_group_that_cannot_fit_is_refused_unless_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    one = group_scheduler.memory_of_group(planned())
    monkeypatch.setattr(group_scheduler, "memory_limit", lambda: one - 1)
    with refuses("train.too_little_memory", value=one, limit=one - 1):
        group_scheduler.refuse_too_little_memory(planned())
    group_scheduler.refuse_too_little_memory(planned(asked=1))


def test_only_what_is_left_to_train_needs_memory(copied: Path, take: Take, monkeypatch: pytest.MonkeyPatch) -> None:
    assert settings_in(copied).run.groups_at_once is None
    monkeypatch.setattr(group_scheduler, "memory_limit", lambda: 1)
    take.forget("train")
    run_take(copied, stages=("train",))
    take.trained_frame(1, 3).unlink()
    with refuses("train.too_little_memory"):
        run_take(copied, stages=("train",))
    # before the colors of the cameras are fitted, which is training too
    with refuses("train.too_little_memory"):
        run_take(copied, "train.camera_colors=splats", stages=("train",))
    assert not take.camera_colors.exists()


def test_one_failure_ends_the_others_and_is_what_is_told() -> None:
    stop = Cancellation()

    def endless() -> None:
        end = time.monotonic() + 120
        while time.monotonic() < end:
            stop.check()
            time.sleep(0.005)
        raise AssertionError("was never stopped")

    def bad() -> None:
        raise StudioError("mask.empty", "no camera sees the performer")

    ran: list[int] = []
    with refuses("mask.empty"):
        group_scheduler.run_groups({0: endless, 1: bad, 2: lambda: ran.append(2)}, 2, [1, 1, 1], stop)
    assert not ran
