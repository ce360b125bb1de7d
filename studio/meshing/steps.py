"""Progress of one step of a longer computation."""

from __future__ import annotations

from typing import Any

from studio.progress import ProgressFn


def part_of(progress: ProgressFn, start: int, stop: int) -> ProgressFn:
    """A callback for one step, mapped to the range `start` to `stop` percent of `progress`."""

    def inner(done: int, total: int, **figures: Any) -> None:
        progress(100 * start + round(100 * (stop - start) * done / max(total, 1)), 10_000, **figures)

    return inner
