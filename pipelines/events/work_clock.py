"""A clock of work time that stops while the process is suspended.

The window or Ctrl-Z can suspend a run at any time (SIGSTOP cannot be handled). On resuming, the process gets SIGCONT,
which does not say how long it was suspended. So the watchdog (`cancellation`) samples the time a few times per second:
a gap between two samples followed by SIGCONT is a pause; any other gap (a library that held the GIL, a busy machine) is
work.
"""

import threading
import time
from collections.abc import Callable

_GAP = 1.0  # seconds without a sample that may be a pause
_UNEXPLAINED = 5.0
"""Seconds after which a gap without SIGCONT counts as work; until then it counts as a pause, so that the clock never
runs backwards."""


class WorkClock:
    """A monotonic clock in seconds that excludes pauses. Thread-safe."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._lock = threading.Lock()
        self._last = now()
        self._gap = 0.0  # not yet known to be a pause or work
        self._gap_ended = now()
        self._paused = 0.0

    def __call__(self) -> float:
        """Seconds since an arbitrary reference; call this a few times per second, which samples the time."""
        with self._lock:
            now = self._now()
            if now - self._last > _GAP:
                self._gap += now - self._last
                self._gap_ended = now
            elif now - self._gap_ended > _UNEXPLAINED:
                self._gap = 0.0
            self._last = now
            return now - self._paused - self._gap

    def continued(self) -> None:
        """The process received SIGCONT: the gap that has just ended was a pause."""
        self()
        with self._lock:
            self._paused += self._gap
            self._gap = 0.0
