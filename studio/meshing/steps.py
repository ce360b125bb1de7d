"""Progress of a step within a longer work."""

from __future__ import annotations

from typing import Any

from studio.progress import ProgressFn


def part_of(progress: ProgressFn, start: int, stop: int) -> ProgressFn:
    """A step's own progress as the stretch from `start` to `stop` of 100."""

    def inner(done: int, total: int, **figures: Any) -> None:
        progress(start + round((stop - start) * done / max(total, 1)), 100, **figures)

    return inner
