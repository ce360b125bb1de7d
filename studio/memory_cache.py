"""The cache in memory that everything uses: keyed values up to a total size."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from typing import Generic, TypeAlias, TypeVar

import numpy as np

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


class MemoryCache(Generic[Key, Value]):
    """Drops the least recently used values first. Thread-safe. Cached values must not be modified.

    `limit`: total size of all values, in the unit of `size_of`, by default their number; larger values are not cached.
    `least`: number of values that are kept whatever their size. `used`: total size of the cached values.
    """

    def __init__(self, limit: float, size_of: Callable[[Value], int] = lambda value: 1, least: int = 0) -> None:
        self.limit, self.size_of, self._least = limit, size_of, least
        self._values: OrderedDict[Key, Value] = OrderedDict()
        self.used = 0
        self._lock = threading.Lock()
        self._making: dict[Key, threading.Lock] = {}

    def __contains__(self, key: Key) -> bool:
        """Whether `key` is cached; does not count as a use."""
        with self._lock:
            return key in self._values

    def __iter__(self) -> Iterator[Key]:
        """Keys of the cached values, the least recently used first."""
        with self._lock:
            return iter(list(self._values))

    def get(self, key: Key) -> Value | None:
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
            return self._values.get(key)

    def put(self, key: Key, value: Value) -> None:
        """Cache a value under `key`; the least recently used ones are dropped if there is no room."""
        size = self.size_of(value)
        with self._lock:
            self._drop(key)
            if size > self.limit and not self._least:
                return
            while self.used + size > self.limit and len(self._values) >= max(self._least, 1):
                self._drop(next(iter(self._values)))
            self._values[key] = value
            self.used += size

    def get_or_make(self, key: Key, make: Callable[[Key], Value]) -> Value:
        """The value cached under `key`; if there is none, what `make` returns, which is then cached. Each value is made
        once; other keys do not wait for it. If `make` raises, so does this, and the next call tries again."""
        with self._lock:
            making = self._making.setdefault(key, threading.Lock())
        with making:
            with self._lock:
                if key in self._values:
                    self._values.move_to_end(key)
                    return self._values[key]
            value = make(key)
            self.put(key, value)
            return value

    def drop(self, key: Key) -> None:
        with self._lock:
            self._drop(key)

    def clear(self) -> None:
        with self._lock:
            self._values.clear()
            self.used = 0

    def _drop(self, key: Key) -> None:
        if key in self._values:
            self.used -= self.size_of(self._values.pop(key))


ImageCache: TypeAlias = MemoryCache[Hashable, tuple[np.ndarray, ...]]


def image_cache(limit: float) -> ImageCache:
    """A cache of arrays that is limited by their bytes."""
    return MemoryCache(limit, bytes_of)


def bytes_of(arrays: tuple[np.ndarray, ...]) -> int:
    """Total size of arrays."""
    return sum(array.nbytes for array in arrays)
