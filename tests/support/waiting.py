"""Waiting for a state instead of sleeping, so that tests pass on a busy machine."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

POLL = 0.02
"""Seconds between two looks."""


def wait_until(what: str, accept: Callable[[], bool], seconds: float = 60.0) -> None:
    """Poll until accepted; the test fails with "never {what}" after so many seconds."""
    end = time.monotonic() + seconds
    while not accept():
        if time.monotonic() > end:
            pytest.fail(f"never {what}")
        time.sleep(POLL)
