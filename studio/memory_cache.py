"""The cache that holds values in memory, and sequences that make their items when they are asked for."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Any, Generic, TypeAlias, TypeVar
from weakref import WeakValueDictionary

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
        # of keys that a thread makes or waits for
        self._making: WeakValueDictionary[Key, threading.Lock] = WeakValueDictionary()

    def __contains__(self, key: Key) -> bool:
        """Return whether `key` is cached; does not count as a use."""
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


class OnDemand(Sequence[Value], Generic[Key, Value]):
    """Items that `make` makes of keys at each access: the frames of a group, or the images of a large rig, which do not
    fit into memory together."""

    def __init__(self, keys: Sequence[Key], make: Callable[[Key], Value]) -> None:
        self._keys, self._make = keys, make

    def __len__(self) -> int:
        return len(self._keys)

    def __iter__(self) -> Iterator[Value]:
        return map(self._make, self._keys)

    def __getitem__(self, index: Any) -> Any:
        keys = self._keys[index]
        return OnDemand(keys, self._make) if isinstance(index, slice) else self._make(keys)


ImageCache: TypeAlias = MemoryCache[Hashable, tuple[np.ndarray, ...]]


def image_cache(limit: float) -> ImageCache:
    """A cache of arrays that is limited by their bytes."""
    return MemoryCache(limit, lambda arrays: sum(array.nbytes for array in arrays))
