"""Redraws that are asked for again. Open3D now and then does not show a change until the next event."""

from __future__ import annotations

import time
from collections.abc import Callable

AGAIN_SECONDS = (0.05, 0.12, 0.25, 0.5, 1.0, 2.0, 4.0)


class Redraws:
    """After `changed`, `due` is true at once and again at `AGAIN_SECONDS`.

    Args:
        now: a clock in seconds that never runs backwards.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._times: list[float] = []

    def changed(self) -> None:
        """Something that is shown has changed."""
        start = self._now()
        self._times = [start, *(start + delay for delay in AGAIN_SECONDS)]

    def due(self) -> bool:
        """Whether to draw now; call at each tick."""
        now = self._now()
        waiting = [moment for moment in self._times if moment > now]
        due = len(waiting) < len(self._times)
        self._times = waiting
        return due
