"""SwapGuard: refuses clicks on a button that has just taken another one's place under a resting pointer."""

import time
from collections.abc import Callable

WAIT = 0.5
"""Seconds after buttons are seen to have changed in which a click at the same place is for what was there before."""

REST = 0.7  # distance in em up to which a pointer counts as resting


class SwapGuard:
    """Refuses clicks meant for another button. `pointer`: its position in the window, pixels; None: refuses nothing."""

    def __init__(self, pointer: Callable[[], tuple[int, int] | None], em: float) -> None:
        self._pointer, self._rest = pointer, REST * em
        self._at: tuple[int, int] | None = None
        self._seen: float | None = None

    def swapped(self) -> None:
        """Other buttons have come to where some were."""
        self._at, self._seen = self._pointer(), None

    def drawn(self) -> None:
        """The window is drawn: from now on the user can see what has changed."""
        if self._at is not None and self._seen is None:
            self._seen = time.monotonic()

    def refuses(self) -> bool:
        """Whether a click that comes now is to be ignored."""
        if self._at is None or (self._seen is not None and time.monotonic() >= self._seen + WAIT):
            return False
        pointer = self._pointer()
        if pointer is None:
            return False
        x, y = pointer
        return abs(x - self._at[0]) <= self._rest and abs(y - self._at[1]) <= self._rest
