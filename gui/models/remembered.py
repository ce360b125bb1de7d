"""A look at files that is not repeated at each tick: a long take has thousands of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Generic, TypeVar

Key = TypeVar("Key")
Found = TypeVar("Found")

SECONDS = 0.5


class Remembered(Generic[Key, Found]):
    """What a look at something has found, for as long as it is new.

    Args:
        look: looks at what is named by a key; takes a while.
        seconds: how long what it found is returned again for the same key.
        now: a clock in seconds that never runs backwards.
    """

    def __init__(
        self, look: Callable[[Key], Found], seconds: float = SECONDS, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._look, self._seconds, self._now = look, seconds, now
        self._found: tuple[Key, Found, float] | None = None

    def get(self, key: Key) -> Found:
        """What was found for the key; keys are compared for equality."""
        if self._found is None or self._found[0] != key or self._now() >= self._found[2] + self._seconds:
            found = self._look(key)
            self._found = (key, found, self._now())
        return self._found[1]
