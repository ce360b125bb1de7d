"""The time left on a simulated run: long keyframes, noisy frames, one that hangs."""

import random
from itertools import chain

import numpy as np
import pytest

from v3studio.pipelines.config import Config
from v3studio.pipelines.events import Progress
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.stages.reporter import Countdown, StageReporter
from v3studio.pipelines.stages.training.progress import Kind, TrainClock
from v3studio.pipelines.takes.frames.groups import Group


def simulated(seed: int) -> list[tuple[float, float]]:
    """(true seconds left, shown) at each progress event of `train`."""
    chance, config = random.Random(seed), Config()
    groups = [Group(index=one, first=15 * one, frames=tuple(range(15 * one, 15 * one + 15))) for one in (0, 1)]
    now = [0.0]
    events = []
    reporter = StageReporter("train", events.append, clock=lambda: now[0], own=85, later=8)
    clock = TrainClock(groups, {0: set(), 1: set()}, config.train)
    times = []
    for group in groups:
        for position in (group.middle, *chain(*group.sides)):
            # 12,000 + 2,000 steps, and 500 of motion + 2,000, on a machine where motion is slower than expected
            seconds = (350.0 if position == group.middle else 140.0) * chance.lognormvariate(0, 0.3)
            if (group.index, position) == (0, 9):
                seconds = 600.0  # the machine is busy
            kind: Kind = "keyframe" if position == group.middle else "later"
            place = (group.index, position)
            parts = max(1, round(seconds / 5))
            for part in range(1, parts + 1):
                now[0] += seconds / parts
                clock.reached(place, kind, part / parts)
                reporter.progress(clock.fraction)
                times.append(now[0])
            clock.finished(place, kind, seconds)
    shown = zip(times, [event.seconds_left for event in events], strict=True)
    return [(now[0] - time, left) for time, left in shown if left is not None]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_does_not_jump_and_is_right_in_the_end(seed: int) -> None:
    true, shown = (list(column) for column in zip(*simulated(seed), strict=True))
    jumps = np.abs(np.diff(shown) - np.diff(true))  # from each figure to the next, less the time that has passed
    assert jumps.max() < 0.02 * true[0], "the mean pace since the start jumps by half of the time"
    late = [abs(left - right) for right, left in zip(true, shown, strict=True) if right < 0.5 * true[0]]
    assert max(late) < 0.2 * true[0]
    last = [abs(left - right) for right, left in zip(true, shown, strict=True) if right < 60]
    assert max(last) < 30


def test_a_countdown_goes_with_the_clock_and_comes_to_new_estimates() -> None:
    countdown = Countdown()
    assert countdown.at(5) is None
    assert countdown.estimate(10, 100) == 100
    assert countdown.at(30) == 80
    assert countdown.at(500) == 0
    assert countdown.estimate(30, 80) == 80
    left = [countdown.estimate(30 + second, 300 - second) for second in range(1, 121)]
    assert left[0] < 130  # a single estimate changes little
    assert left[-1] == pytest.approx(180, rel=0.02)


def test_the_whole_run_keeps_its_countdown_across_stages() -> None:
    now, events = [0.0], []
    countdown = Countdown()
    first = StageReporter("initialize", events.append, clock=lambda: now[0], own=10, later=90, run=countdown)
    for step in range(1, 101):
        now[0] += 1
        first.progress(step / 100)
    assert events[-1].seconds_left == 0
    assert events[-1].total_seconds_left == pytest.approx(900, rel=0.01)
    now[0] += 1
    second = StageReporter(
        "train", events.append, Cancellation(), lambda: now[0], 90, 0, now[0], first.total_fraction, 10, countdown
    )
    now[0] += 1
    second.progress(0.0001)  # too early to tell from this stage
    assert events[-1].seconds_left is None
    assert events[-1].total_seconds_left == pytest.approx(898, rel=0.01)
    for step in range(1, 451):  # this stage is twice as fast as its weight says
        now[0] += 1
        second.progress(step / 450)
        if step == 225:
            assert events[-1].total_seconds_left == pytest.approx(225, rel=0.1)
    assert events[-1].total_seconds_left == 0
    fractions = [event.total_fraction for event in events]
    assert fractions == sorted(fractions)
    assert fractions[-1] == pytest.approx(1)


def warming_up(own: float, later: float) -> list[tuple[float, Progress]]:
    """Seconds and progress of a stage of 200 steps whose first ten take six times as long as the others."""
    now, events = [0.0], []
    reporter = StageReporter("train", events.append, clock=lambda: now[0], own=own, later=later)
    found = []
    for step in range(1, 201):
        now[0] += 3.0 if step <= 10 else 0.5
        reporter.progress(step / 200)
        found.append((now[0], events[-1]))
    return found


def test_warming_up_is_not_taken_for_the_pace() -> None:
    rows = warming_up(85, 8)
    end = rows[-1][0]
    assert rows[1][1].seconds_left is None, "nothing is told before there are figures"
    now, event = next((now, event) for now, event in rows if now > 60)
    assert event.seconds_left < 1.5 * (end - now)
    assert now * (1 - event.fraction) / event.fraction > 1.6 * (end - now), "the mean pace since the start is far off"


def test_a_short_first_stage_does_not_foretell_the_run() -> None:
    rows = warming_up(7, 93)
    assert all(event.total_seconds_left is None for _, event in rows)
    fractions = [event.total_fraction for _, event in rows]
    assert fractions == sorted(fractions)


def test_counting_tells_no_time_left() -> None:
    now, events = [0.0], []
    reporter = StageReporter("train", events.append, clock=lambda: now[0])
    for step in range(1, 100):
        now[0] += 1
        reporter.progress(step / 100)
    assert events[-1].seconds_left is not None
    now[0] += 1
    reporter.counting("checking image")(3, 20)
    assert (events[-1].fraction, events[-1].seconds_left, events[-1].label) == (0.99, None, "checking image 3 of 20")
