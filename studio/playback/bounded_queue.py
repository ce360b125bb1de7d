"""A bounded queue between two threads that can be finished (it ends when empty) or aborted (it ends immediately)."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

_POLL = 0.01  # seconds between checks of `stale` while the queue is full


class BoundedQueue(Generic[T]):
    """A FIFO queue of at most `capacity` items. None is not a valid item."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._items: deque[T] = deque()
        self._changed = threading.Condition()
        self._finished = False
        self._aborted = False

    def put(self, item: T, stale: Callable[[T], bool] | None = None) -> int | None:
        """Append an item, waiting while the queue is full; returns the number of items dropped to make room, or None if
        it was aborted. When full, the oldest item is dropped if `stale` is true for the second oldest: it is due."""
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

    def get(self) -> T | None:
        """Remove and return the oldest item; None if the queue is over."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._finished or self._aborted)
            if self._aborted or not self._items:
                return None
            item = self._items.popleft()
            self._changed.notify_all()
            return item

    def peek(self) -> T | None:
        """The oldest item, without removing it; None if there is none."""
        with self._changed:
            return self._items[0] if self._items and not self._aborted else None

    @property
    def over(self) -> bool:
        """Whether the queue is empty and no more items will be added."""
        with self._changed:
            return self._aborted or (self._finished and not self._items)

    def finish(self) -> None:
        """Declare that no more items will be added; those in the queue can still be removed."""
        with self._changed:
            self._finished = True
            self._changed.notify_all()

    def abort(self) -> None:
        """Drop all items and release all waiting threads."""
        with self._changed:
            self._aborted = True
            self._items.clear()
            self._changed.notify_all()
