"""Stopping a run: Ctrl-C and SIGTERM, cleanly, within two seconds.

A signal sets a flag. The stages' progress callbacks look at the flag and raise `Cancelled`, which unwinds the stage.
A call into C++ that takes long (structure from motion, an import) does not come back in time to look; then a watchdog
thread ends the process after `GRACE` seconds. That loses nothing: results are only ever moved into place whole. The
watchdog is woken through `signal.set_wakeup_fd`, because Python's own handlers wait for the main thread; it needs the
called library to release the interpreter lock, as torch, pycolmap, PyAV and Open3D do in their long calls.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from studio.errors import Cancelled

GRACE = 1.4
"""Seconds that a stage has to end by itself."""

EXIT_CANCELLED = 130
"""Exit code of a run that was stopped (128 + SIGINT, as shells count)."""


class Cancellation:
    """A flag that says stop; thread safe."""

    def __init__(self) -> None:
        self._event = threading.Event()

    def cancel(self) -> None:
        """Ask the work to stop."""
        self._event.set()

    @property
    def cancelled(self) -> bool:
        """True once somebody asked."""
        return self._event.is_set()

    def check(self) -> None:
        """Raises Cancelled if somebody asked."""
        if self._event.is_set():
            raise Cancelled


@contextmanager
def stop_on_signals(cancellation: Cancellation, last_words: Callable[[], None]) -> Iterator[None]:
    """While the block runs, SIGINT and SIGTERM set `cancellation`; the process ends at the latest GRACE later.

    Args:
        cancellation: the flag to set.
        last_words: called by the watchdog just before it ends the process the hard way.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # signals belong to the main thread; a caller on another one cancels by the flag
        return
    finished = threading.Event()
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)

    def handler(number: int, frame: FrameType | None) -> None:
        cancellation.cancel()

    def watch() -> None:
        while True:
            data = os.read(read_end, 64)
            if not data:
                return
            if any(number in (signal.SIGINT, signal.SIGTERM) for number in data):
                cancellation.cancel()
                if not finished.wait(GRACE):
                    last_words()
                    os._exit(EXIT_CANCELLED)
                return

    watchdog = threading.Thread(target=watch, name="watchdog", daemon=True)
    before = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    before_fd = signal.set_wakeup_fd(write_end, warn_on_full_buffer=False)
    watchdog.start()
    try:
        yield
    finally:
        finished.set()
        signal.set_wakeup_fd(before_fd)
        for number, old in before.items():
            signal.signal(number, old)
        os.close(write_end)
        watchdog.join(timeout=1)
        os.close(read_end)
