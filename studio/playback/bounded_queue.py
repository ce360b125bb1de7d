"""A bounded queue between two threads that can be finished (drained, then over) or aborted (over now)."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

_POLL = 0.01  # seconds between looks at the clock while a full lane waits for its oldest item to grow stale


class BoundedQueue(Generic[T]):
    """At most `capacity` items, in order; None is never an item."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._items: deque[T] = deque()
        self._changed = threading.Condition()
        self._finished = False
        self._aborted = False

    def put(self, item: T, stale: Callable[[T], bool] | None = None) -> int | None:
        """Add an item, waiting for room.

        Args:
            item: goes to the end.
            stale: with a full lane, the oldest item is dropped if `stale(second oldest)` says that the second one is
                already wanted in its place.

        Returns:
            how many items were dropped to make room, or None if the lane was aborted.
        """
        dropped = 0
        with self._changed:
            while len(self._items) >= self._capacity and not self._aborted:
                if stale is not None and stale(self._items[1] if len(self._items) > 1 else item):
                    self._items.popleft()
                    dropped += 1
                else:
                    self._changed.wait(None if stale is None else _POLL)
            if self._aborted:
                return None
            self._items.append(item)
            self._changed.notify_all()
        return dropped

    def get(self, timeout: float | None = None) -> T | None:
        """The oldest item; None when the lane is over, or nothing came within `timeout` seconds."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._finished or self._aborted, timeout)
            if self._aborted or not self._items:
                return None
            item = self._items.popleft()
            self._changed.notify_all()
            return item

    def take_while(self, wanted: Callable[[T], bool]) -> list[T]:
        """Remove items from the front for as long as `wanted` says so; never waits."""
        taken: list[T] = []
        with self._changed:
            while self._items and not self._aborted and wanted(self._items[0]):
                taken.append(self._items.popleft())
            if taken:
                self._changed.notify_all()
        return taken

    def peek(self) -> T | None:
        """The oldest item, left where it is."""
        with self._changed:
            return self._items[0] if self._items and not self._aborted else None

    @property
    def over(self) -> bool:
        """True when nothing is there and nothing will come."""
        with self._changed:
            return self._aborted or (self._finished and not self._items)

    def finish(self) -> None:
        """Nothing more will be put; what is there can still be taken."""
        with self._changed:
            self._finished = True
            self._changed.notify_all()

    def abort(self) -> None:
        """Drop everything and let all waiting threads go."""
        with self._changed:
            self._aborted = True
            self._items.clear()
            self._changed.notify_all()
