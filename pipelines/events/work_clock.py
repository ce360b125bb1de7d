"""A clock for how long work takes, which stands still while the process is halted.

A run can be paused by the window or by Ctrl-Z, and is told nothing of it: the system simply stops it. When it goes on
it gets SIGCONT, but by then nobody knows since when it stood. So a thread looks at the time a few times a second; a
gap between two looks that a SIGCONT follows is a pause. A gap without one (a library that held the interpreter's lock,
a busy machine) is work.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_LOOK = 0.2
"""Seconds between two looks."""

_GAP = 1.0
"""Seconds without a look that may be a pause."""

_UNEXPLAINED = 60.0
"""Seconds after which a gap that no SIGCONT followed counts as work; until then as a pause, so that the clock never
runs backwards. Python tells of signals only when the main thread has time."""


class WorkClock:
    """Seconds of a monotonic clock without the pauses. Thread safe.

    Args:
        now: the clock below.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._lock = threading.Lock()
        self._last = now()
        self._gap = 0.0  # not explained yet
        self._gap_ended = now()
        self._continued = False
        self._paused = 0.0

    def __call__(self) -> float:
        """Seconds since some fixed moment."""
        with self._lock:
            self._look()
            return self._last - self._paused - self._gap

    @property
    def paused(self) -> float:
        """Seconds of pauses so far."""
        with self._lock:
            self._look()
            return self._paused

    def look(self) -> None:
        """Call a few times a second."""
        with self._lock:
            self._look()

    def continued(self) -> None:
        """The process was told to go on."""
        self._continued = True  # no lock: a signal's handler may come while this thread holds it

    def _look(self) -> None:
        now = self._now()
        if now - self._last > _GAP:
            self._gap += now - self._last
            self._gap_ended = now
        self._last = now
        if self._continued:
            self._continued = False
            self._paused += self._gap
            self._gap = 0.0
        elif now - self._gap_ended > _UNEXPLAINED:
            self._gap = 0.0


@contextmanager
def counting_pauses() -> Iterator[WorkClock]:
    """A clock that knows of this process's pauses while the block runs; on another thread than the main one, to which
    signals belong, it knows of none."""
    clock = WorkClock()
    if threading.current_thread() is not threading.main_thread():
        yield clock
        return
    over = threading.Event()

    def handler(_number: int, _frame: FrameType | None) -> None:
        clock.continued()

    def watch() -> None:
        while not over.wait(_LOOK):
            clock.look()

    before = signal.signal(signal.SIGCONT, handler)
    watcher = threading.Thread(target=watch, name="work clock", daemon=True)
    watcher.start()
    try:
        yield clock
    finally:
        over.set()
        watcher.join()
        signal.signal(signal.SIGCONT, before)
