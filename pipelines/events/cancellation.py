"""Cancellation of a run by Ctrl-C or SIGTERM within two seconds, and its work time.

A signal sets a flag. Progress callbacks check the flag and raise `Cancelled`, which unwinds the stage. A long call into
C++ (structure from motion, an import) may not return in time; then a watchdog thread ends the process after `GRACE`
seconds. No results are lost, since files are written atomically. The watchdog is woken through `signal.set_wakeup_fd`,
because Python's signal handlers only run in the main thread; this requires that the library releases the GIL, as torch,
pycolmap, PyAV and Open3D do in long calls.
"""

import os
import select
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from v3studio.pipelines.events.work_clock import WorkClock
from v3studio.studio.errors import Cancelled

GRACE = 1.4  # seconds that a stage has to stop before the process is ended
_SAMPLE = 0.2  # seconds between two samples of the clock
EXIT_CANCELLED = 130  # exit code of a cancelled command (128 + SIGINT)


class Cancellation:
    """A thread-safe flag."""

    def __init__(self) -> None:
        self._event = threading.Event()

    def cancel(self) -> None:
        self._event.set()

    @property
    def cancelled(self) -> bool:
        return self._event.is_set()

    def check(self) -> None:
        if self._event.is_set():
            raise Cancelled


@contextmanager
def stop_on_signals(cancellation: Cancellation, last_words: Callable[[], None]) -> Iterator[WorkClock]:
    """Within the block, SIGINT and SIGTERM set `cancellation`; the process ends at most `GRACE` seconds later, after
    the watchdog has called `last_words`. Yields a clock that excludes pauses of the process.

    Signals need the main thread: callers on others set the flag themselves, and pauses count as work there."""
    clock = WorkClock()
    if threading.current_thread() is not threading.main_thread():
        yield clock
        return
    finished = threading.Event()
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)

    def handler(number: int, frame: FrameType | None) -> None:
        if number != signal.SIGCONT:
            cancellation.cancel()

    def watch() -> None:
        while not finished.is_set():
            told, _, _ = select.select([read_end], [], [], _SAMPLE)
            clock()
            numbers = os.read(read_end, 64) if told else b""
            if signal.SIGCONT in numbers:
                clock.continued()
            if signal.SIGINT in numbers or signal.SIGTERM in numbers:
                cancellation.cancel()
                if not finished.wait(GRACE):
                    last_words()
                    os._exit(EXIT_CANCELLED)

    watchdog = threading.Thread(target=watch, name="watchdog", daemon=True)
    before = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGCONT)}
    before_fd = signal.set_wakeup_fd(write_end, warn_on_full_buffer=False)
    watchdog.start()
    try:
        yield clock
    finally:
        finished.set()
        signal.set_wakeup_fd(before_fd)
        for number, old in before.items():
            signal.signal(number, old)
        os.close(write_end)
        watchdog.join(timeout=1)
        os.close(read_end)
