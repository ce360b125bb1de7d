"""Keeps libraries from making this process a real-time one.

SVT-AV1, when run by root, gives its own threads and the one that opens it the policy SCHED_FIFO with the highest
priority (`check_set_prio` in its svt_threads.c). Then the thread, its later threads and all programs that it starts
take the processors from everything else on the machine.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def kept_scheduling() -> Iterator[None]:
    """Undo changes of scheduling policy and priority within: threads that were there get theirs back, new ones the
    caller's. Linux only; elsewhere nothing is done, as nothing changes there."""
    if sys.platform != "linux":
        yield
        return
    before = {thread: _policy(thread) for thread in _threads()}
    own = _policy(0)
    try:
        yield
    finally:
        for thread in _threads():
            wanted, now = before.get(thread) or own, _policy(thread)
            if wanted is not None and now is not None and now != wanted:
                with contextlib.suppress(OSError):  # the thread has ended
                    os.sched_setscheduler(thread, wanted[0], os.sched_param(wanted[1]))


def _threads() -> list[int]:
    return [int(name) for name in os.listdir("/proc/self/task")]


def _policy(thread: int) -> tuple[int, int] | None:
    """Policy and priority; None if the thread has ended."""
    try:
        return os.sched_getscheduler(thread), os.sched_getparam(thread).sched_priority
    except OSError:
        return None
