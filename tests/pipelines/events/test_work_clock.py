import pytest

from tests.support.waiting import HandClock
from v3studio.pipelines.events.work_clock import WorkClock


def work(clock: WorkClock, now: HandClock, seconds: float) -> None:
    for _ in range(round(seconds / 0.25)):
        now.time += 0.25
        clock()


@pytest.mark.parametrize("looked_before_told", [True, False])
def test_a_gap_that_sigcont_follows_is_a_pause(looked_before_told: bool) -> None:
    now = HandClock()
    clock = WorkClock(now)
    start = clock()
    work(clock, now, 10)
    now.time += 300
    if looked_before_told:
        clock()
        assert clock() - start == pytest.approx(10), "never ahead of what turns out to be"
    clock.continued()
    work(clock, now, 5)
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
    assert seen[-1] - seen[0] == pytest.approx(now.time)
    clock.continued()  # suspended for too short a time to matter
    assert clock() == seen[-1]
