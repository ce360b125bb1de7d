"""Rate: events per second."""

import time
from collections import deque
from collections.abc import Callable

SPAN = 2.0  # length of the averaging window, seconds


class Rate:
    """Count with `hit`, read `value`. `now` is a clock in seconds that never runs backwards."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._times: deque[float] = deque(maxlen=240)

    def hit(self) -> None:
        self._times.append(self._now())

    @property
    def value(self) -> float:
        """Events per second over the last `SPAN` seconds."""
        horizon = self._now() - SPAN
        recent = [hit for hit in self._times if hit >= horizon]
        return (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 and recent[-1] > recent[0] else 0.0
