"""Failing callbacks: what they raise is reported, and the window stays alive or is closed in order."""

from collections.abc import Callable, Iterator

import pytest

from v3studio.gui.app import MOST_FAILURES, run_ticks


class Ticks:
    """A toolkit whose ticks do as told: "ok", "tick" (the window's own tick raises), "event" (another callback raises
    and the window's tick follows), "closed"."""

    def __init__(self, *steps: str) -> None:
        self.steps: Iterator[str] = iter(steps)
        self.completed = 0
        self.reported: list[str] = []

    def tick(self) -> bool:
        step = next(self.steps)
        if step in ("ok", "event"):
            self.completed += 1
        if step in ("tick", "event"):
            raise RuntimeError(step)
        return step != "closed"

    def run(self, report: Callable[[Exception], None] | None = None) -> bool:
        return run_ticks(self.tick, lambda: self.completed, report or (lambda error: self.reported.append(str(error))))


def test_a_failure_is_reported_and_the_window_goes_on(capsys: pytest.CaptureFixture[str]) -> None:
    ticks = Ticks("ok", "event", *["ok", "tick"] * (2 * MOST_FAILURES), "closed")
    assert ticks.run()
    assert ticks.reported == ["event", *["tick"] * (2 * MOST_FAILURES)]
    assert "RuntimeError: event" in capsys.readouterr().err


def test_a_window_that_only_fails_is_given_up() -> None:
    ticks = Ticks("ok", *["tick"] * MOST_FAILURES)
    assert not ticks.run()
    assert len(ticks.reported) == MOST_FAILURES - 1
