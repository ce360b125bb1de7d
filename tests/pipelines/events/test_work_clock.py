"""Pauses do not count as work: the clock alone, and a run that is actually suspended."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipelines.events.work_clock import WorkClock, counting_pauses
from pipelines.stages.reporter import StageReporter
from tests.support.waiting import HandClock


def work(clock: WorkClock, now: HandClock, seconds: float) -> None:
    for _ in range(round(seconds / 0.25)):
        now.time += 0.25
        clock.look()


@pytest.mark.parametrize("looked_before_told", [True, False])
def test_a_gap_that_sigcont_follows_is_a_pause(looked_before_told: bool) -> None:
    now = HandClock()
    clock = WorkClock(now)
    start = clock()
    work(clock, now, 10)
    now.time += 300
    if looked_before_told:
        clock.look()
        assert clock() - start == pytest.approx(10), "never ahead of what turns out to be"
    clock.continued()
    work(clock, now, 5)
    assert clock.paused == pytest.approx(300, abs=0.3)
    assert clock() - start == pytest.approx(15, abs=0.3)


def test_a_gap_alone_is_work_and_the_clock_never_runs_backwards() -> None:
    now = HandClock()
    clock = WorkClock(now)
    seen = [clock()]
    for gap in (20.0, 0.0):
        now.time += gap
        for _ in range(300):
            work(clock, now, 0.25)
            seen.append(clock())
    assert seen == sorted(seen)
    assert clock.paused == 0
    assert seen[-1] - seen[0] == pytest.approx(now.time)
    clock.continued()  # suspended for too short a time to matter
    assert clock.paused == 0


def test_time_left_does_not_grow_by_a_pause() -> None:
    now = HandClock()
    clock = WorkClock(now)
    events = []
    reporter = StageReporter("train", events.append, clock=clock)
    for fraction in (0.25, 0.5):
        work(clock, now, 25)
        reporter.progress(fraction)
    now.time += 1000
    clock.continued()
    work(clock, now, 25)
    reporter.progress(0.75)
    assert [event.seconds_left for event in events[1:]] == pytest.approx([50, 25], abs=0.5)


SCRIPT = """
import sys, time
from pipelines.events.work_clock import counting_pauses
with counting_pauses() as clock:
    print("ready", flush=True)
    sys.stdin.readline()
    while not clock.paused:
        time.sleep(0.05)
    print(clock.paused, flush=True)
"""


def test_a_process_that_is_halted_knows_it_afterwards() -> None:
    root = Path(__file__).parents[3]
    child = subprocess.Popen(
        [sys.executable, "-c", SCRIPT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=root
    )
    try:
        assert child.stdin is not None
        assert child.stdout.readline() == "ready\n"
        os.kill(child.pid, signal.SIGSTOP)
        time.sleep(3)
        os.kill(child.pid, signal.SIGCONT)
        child.stdin.write("\n")
        child.stdin.flush()
        assert json.loads(child.stdout.readline()) > 2
        assert child.wait(120) == 0
    finally:
        child.kill()


def test_signals_are_as_before_afterwards() -> None:
    before = signal.getsignal(signal.SIGCONT)
    with counting_pauses() as clock:
        assert clock.paused == 0
    assert signal.getsignal(signal.SIGCONT) == before
