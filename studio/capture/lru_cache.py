"""A cache of arrays with a size limit in bytes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable

import numpy as np


class ByteCache:
    """Evicts the least recently used arrays first. Thread safe. Cached arrays must not be modified."""

    def __init__(self, limit: int) -> None:
        """`limit`: total size of all arrays in bytes; larger arrays are not cached."""
        self.limit = limit
        self._arrays: OrderedDict[Hashable, tuple[np.ndarray, ...]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    @property
    def used(self) -> int:
        """Bytes currently cached."""
        return self._bytes

    def get(self, key: Hashable) -> tuple[np.ndarray, ...] | None:
        """The arrays cached under `key`, or None."""
        with self._lock:
            arrays = self._arrays.get(key)
            if arrays is not None:
                self._arrays.move_to_end(key)
            return arrays

    def holds(self, key: Hashable) -> bool:
        """Whether `key` is cached."""
        with self._lock:
            return key in self._arrays

    def drop(self, key: Hashable) -> None:
        """Remove `key` if it is cached."""
        with self._lock:
            self._bytes -= sum(array.nbytes for array in self._arrays.pop(key, ()))

    def put(self, key: Hashable, *arrays: np.ndarray) -> None:
        """Cache arrays under `key`, evicting the least recently used ones if necessary."""
        size = sum(array.nbytes for array in arrays)
        with self._lock:
            old = self._arrays.pop(key, None)
            if old is not None:
                self._bytes -= sum(array.nbytes for array in old)
            if size > self.limit:
                return
            while self._arrays and self._bytes + size > self.limit:
                _, evicted = self._arrays.popitem(last=False)
                self._bytes -= sum(array.nbytes for array in evicted)
            self._arrays[key] = arrays
            self._bytes += size
