"""A request to cancel the run of a take, from any machine that sees its folder."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pipelines.takes.atomic_files import remove, write_text
from pipelines.takes.take import Take

_LOOK = 0.5
"""Seconds between two looks for a request."""


def request_cancel(take: Take) -> None:
    """Ask the run in progress to stop; it does within seconds, and keeps finished work.

    Raises:
        OSError: the request cannot be written.
    """
    write_text(take.cancel_request, "")


@contextmanager
def cancelled_on_request(take: Take, cancel: Callable[[], None]) -> Iterator[None]:
    """Within the block, `cancel` is called from another thread when a request arrives. Older requests are dropped."""
    remove(take.cancel_request)
    over = threading.Event()

    def watch() -> None:
        while not over.wait(_LOOK):
            if take.cancel_request.exists():
                cancel()
                return

    watcher = threading.Thread(target=watch, name="cancel requests", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()
        remove(take.cancel_request)
