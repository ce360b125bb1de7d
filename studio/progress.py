"""Progress callbacks of long-running library functions.

Long-running functions take `progress: ProgressFn = no_progress` and call it several times per second. The callback may
raise `studio.errors.Cancelled` to stop the work; the library lets that exception pass.
"""

from typing import Any, Protocol


class ProgressFn(Protocol):
    """`progress(done, total, loss=0.03, psnr=31.2, ...)`: steps done, steps in total, current metrics."""

    def __call__(self, done: int, total: int, **figures: Any) -> None: ...


def no_progress(done: int, total: int, **figures: Any) -> None:
    """A `ProgressFn` that does nothing."""


def part_of(progress: ProgressFn, start: int, stop: int) -> ProgressFn:
    """A callback for one step, mapped to the range `start` to `stop` percent of `progress`."""

    def inner(done: int, total: int, **figures: Any) -> None:
        progress(100 * start + round(100 * (stop - start) * done / max(total, 1)), 10_000, **figures)

    return inner
