"""Waiting for a state instead of sleeping, and a clock set by hand, so that tests pass on a busy machine."""

import time
from collections.abc import Callable

import pytest

POLL = 0.02
"""Seconds between two checks."""


def wait_until(what: str, accept: Callable[[], bool], seconds: float = 120.0) -> None:
    """Poll until the state is accepted; after the given number of seconds, the test fails with "never {what}"."""
    end = time.monotonic() + seconds
    while not accept():
        if time.monotonic() > end:
            pytest.fail(f"never {what}")
        time.sleep(POLL)


class HandClock:
    """A clock that stands still until a test sets `time`, in seconds."""

    def __init__(self) -> None:
        self.time = 0.0

    def __call__(self) -> float:
        return self.time
