"""Rest: whether the view has rested for a moment, so that there is time for a better image."""

import time
from collections.abc import Callable, Hashable

RESTS_AFTER = 0.4  # seconds without a change


class Rest:
    """See the module. `now` is a clock in seconds that never runs backwards."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._view: Hashable = None
        self._since = 0.0

    def rests(self, view: Hashable, moving: bool) -> bool:
        """Whether the view has been equal for `RESTS_AFTER`. Call at each tick. `moving`: it moves on its own."""
        if moving or view != self._view:
            self._view, self._since = view, self._now()
        return self._now() - self._since >= RESTS_AFTER
