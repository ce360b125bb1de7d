"""A clock of work time that stops while the process is suspended.

The window or Ctrl-Z can suspend a run at any time (SIGSTOP cannot be handled). On resuming, the process gets SIGCONT,
which does not say how long it was suspended. So a thread samples the time a few times per second: a gap between two
samples followed by SIGCONT is a pause; any other gap (a library that held the GIL, a busy machine) is work.
"""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_LOOK = 0.2  # seconds between two samples
_GAP = 1.0  # seconds without a sample that may be a pause
_UNEXPLAINED = 60.0
"""Seconds after which a gap without SIGCONT counts as work; until then it counts as a pause, so that the clock never
runs backwards. Python calls signal handlers only when the main thread is free."""


class WorkClock:
    """A monotonic clock in seconds that excludes pauses. Thread-safe."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._lock = threading.Lock()
        self._last = now()
        self._gap = 0.0  # not yet known to be a pause or work
        self._gap_ended = now()
        self._continued = False
        self._paused = 0.0

    def __call__(self) -> float:
        """Seconds since an arbitrary reference; call this a few times per second, which samples the time."""
        with self._lock:
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
            return self._last - self._paused - self._gap

    def continued(self) -> None:
        """The process received SIGCONT."""
        self._continued = True  # no lock: a signal handler may interrupt the thread that holds it


@contextmanager
def counting_pauses() -> Iterator[WorkClock]:
    """A clock that excludes pauses of this process. Signals need the main thread; on others, pauses count as work."""
    clock = WorkClock()
    if threading.current_thread() is not threading.main_thread():
        yield clock
        return
    over = threading.Event()

    def handler(_number: int, _frame: FrameType | None) -> None:
        clock.continued()

    def watch() -> None:
        while not over.wait(_LOOK):
            clock()

    before = signal.signal(signal.SIGCONT, handler)
    watcher = threading.Thread(target=watch, name="work clock", daemon=True)
    watcher.start()
    try:
        yield clock
    finally:
        over.set()
        watcher.join()
        signal.signal(signal.SIGCONT, before)
