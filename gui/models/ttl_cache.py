"""TtlCache: the newest result of a slow function, for a while, such as of listing the thousands of files of a take."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Generic, TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")

SECONDS = 0.5


class TtlCache(Generic[Key, Value]):
    """See the module.

    Args:
        function: called with a key.
        seconds: how long its result is returned again for an equal key.
    """

    def __init__(
        self, function: Callable[[Key], Value], seconds: float = SECONDS, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._function, self._seconds, self._now = function, seconds, now
        self._newest: tuple[Key, Value, float] | None = None

    def get(self, key: Key) -> Value:
        """The function's result for the key."""
        if self._newest is None or self._newest[0] != key or self._now() >= self._newest[2] + self._seconds:
            value = self._function(key)
            self._newest = (key, value, self._now())
        return self._newest[1]
