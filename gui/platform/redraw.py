"""Repeated redraw requests: Open3D sometimes does not show a change until the next event.

It drops a frame while the last one is still being drawn. That takes seconds where a busy CPU draws a large window, so
that its last change might never be seen. So requests are repeated for a while.
"""

import time

AGAIN_SECONDS = (0.05, 0.12, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)


class Redraws:
    """Draws that are `due` after `changed`: at once and after `AGAIN_SECONDS`, at least `pause` seconds apart."""

    def __init__(self) -> None:
        self.pause = 0.0  # least seconds between two draws: if the CPU draws the window, they compete with rendering
        self._times: list[float] = []
        self._last = -float("inf")

    def changed(self) -> None:
        """Note that something on screen has changed."""
        start = time.monotonic()
        # a due redraw stays due; otherwise steady changes would postpone it forever
        self._times = [min([start, *self._times[:1]]), *(start + delay for delay in AGAIN_SECONDS)]

    @property
    def pausing(self) -> bool:
        """Whether the last draw was less than `pause` seconds ago."""
        return time.monotonic() < self._last + self.pause

    def due(self) -> bool:
        """Whether to draw now; call at each tick."""
        if self.pausing:
            return False
        now = time.monotonic()
        waiting = [due for due in self._times if due > now]
        due = len(waiting) < len(self._times)
        self._times = waiting
        if due:
            self._last = now
        return due
