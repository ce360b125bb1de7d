"""Groups side by side: they are independent, and several on a thread each use a CPU better than one on all threads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import TYPE_CHECKING

import psutil

from studio.errors import Cancelled

if TYPE_CHECKING:
    from pipelines.events.cancellation import Cancellation
    from pipelines.stages.base import Context

_MOST = 8
"""More threads than these wait for each other at Python's lock."""

_BYTES_A_PIXEL = 16
"""Of a training view: 8 channels of bytes, and the next frame's while this one trains."""

_BYTES_A_SMALL_PIXEL = 80
"""Of a view that is kept as floats too."""

_BYTES_A_DRAWN_PIXEL = 200
"""Of the view that is drawn just now: float32 pictures, targets and gradients."""


def groups_at_once(context: Context) -> int:
    """How many groups are trained side by side: `run.groups_at_once`, or as threads and memory allow."""
    asked, groups = context.config.run.groups_at_once, len(context.groups)
    if asked is not None:
        return min(asked, groups)
    if context.device != "cpu":
        return 1
    from studio.training.views import KEPT_PIXELS

    footage = context.footage.calibrated
    pixels = [footage.rig[name].width * footage.rig[name].height for name in footage.train_cameras]
    each = sum(max(_BYTES_A_PIXEL * one, _BYTES_A_SMALL_PIXEL * min(one, KEPT_PIXELS)) for one in pixels)
    each += _BYTES_A_DRAWN_PIXEL * max(pixels, default=1)
    memory = psutil.virtual_memory().total // 2
    return max(1, min(groups, context.threads, _MOST, memory // each))


def threads_by_group(groups: int, at_once: int, threads: int) -> list[int]:
    """CPU threads for each of the take's groups; where the last round has fewer groups, they get more.

    It depends on the group's index alone and not on which groups are left to train, because sums over several threads
    round differently: a run that was broken off must end with the same bits.
    """
    full = groups - groups % at_once
    last = max(1, threads // (groups % at_once)) if groups % at_once else 0
    return [max(1, threads // at_once) if index < full else last for index in range(groups)]


def run_groups(
    jobs: Mapping[int, Callable[[], None]], at_once: int, threads: Sequence[int], stop: Cancellation
) -> None:
    """Do the jobs, a group's each, so many at a time.

    Args:
        jobs: by group index, in the order in which they begin.
        at_once: threads of control.
        threads: CPU threads by group index.
        stop: set when a job fails, so that the others end soon.

    Raises:
        Exception: the first that a job raised; Cancelled only if no job raised anything else.
    """
    import torch

    def work(index: int, job: Callable[[], None]) -> None:
        torch.get_num_threads()  # asked first in a thread it takes the number that any thread set last, ours included
        torch.set_num_threads(threads[index])  # OpenMP keeps it for each calling thread
        stop.check()
        job()

    before = torch.get_num_threads()
    try:
        if at_once == 1:
            for index, job in jobs.items():
                work(index, job)
            return
        with ThreadPoolExecutor(at_once, thread_name_prefix="group") as lanes:
            futures = [lanes.submit(work, index, job) for index, job in jobs.items()]
            done, _ = wait(futures, return_when=FIRST_EXCEPTION)
            if any(future.exception() is not None for future in done):
                stop.cancel()
        errors = [error for future in futures if (error := future.exception()) is not None]
        for error in sorted(errors, key=lambda error: isinstance(error, Cancelled)):
            raise error
    finally:
        torch.set_num_threads(before)
