"""Progress of a step within a longer work."""

from __future__ import annotations

from typing import Any

from studio.progress import ProgressFn


def part_of(progress: ProgressFn, start: int, stop: int) -> ProgressFn:
    """A step's own progress as the stretch from `start` to `stop` of 100, in hundredths."""

    def inner(done: int, total: int, **figures: Any) -> None:
        progress(100 * start + round(100 * (stop - start) * done / max(total, 1)), 10_000, **figures)

    return inner
