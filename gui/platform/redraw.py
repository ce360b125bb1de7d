"""Redraws that are asked for again. Open3D now and then does not show a change until the next event."""

from __future__ import annotations

import time
from collections.abc import Callable

AGAIN_SECONDS = (0.05, 0.12, 0.25, 0.5, 1.0, 2.0, 4.0)


class Redraws:
    """After `changed`, `due` is true at once and again at `AGAIN_SECONDS`, but never more often than `pause` allows.

    Args:
        now: a clock in seconds that never runs backwards.
        pause: least seconds between two drawings. Where the processor draws the window, each takes time away from what
            is to be shown.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic, pause: float = 0.0) -> None:
        self._now = now
        self.pause = pause
        self._times: list[float] = []
        self._last = -float("inf")

    def changed(self) -> None:
        """Something that is shown has changed."""
        start = self._now()
        # one that is already due stays so, or steady changes would put it off for ever
        first = min(start, *self._times[:1]) if self._times else start
        self._times = [first, *(start + delay for delay in AGAIN_SECONDS)]

    @property
    def pausing(self) -> bool:
        """Whether the last drawing was so recent that there is none now."""
        return self._now() < self._last + self.pause

    def due(self) -> bool:
        """Whether to draw now; call at each tick."""
        if self.pausing:
            return False
        now = self._now()
        waiting = [moment for moment in self._times if moment > now]
        due = len(waiting) < len(self._times)
        self._times = waiting
        if due:
            self._last = now
        return due
