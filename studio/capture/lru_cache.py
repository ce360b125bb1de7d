"""A cache of arrays that keeps within a number of bytes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable

import numpy as np


class ByteCache:
    """Least recently used arrays go first. Thread safe. Arrays inside are never written to."""

    def __init__(self, limit: int) -> None:
        """`limit`: bytes of all arrays together; an array larger than that is not kept."""
        self.limit = limit
        self._arrays: OrderedDict[Hashable, tuple[np.ndarray, ...]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    @property
    def used(self) -> int:
        """Bytes held now."""
        return self._bytes

    def get(self, key: Hashable) -> tuple[np.ndarray, ...] | None:
        """The arrays stored under `key`, or None."""
        with self._lock:
            arrays = self._arrays.get(key)
            if arrays is not None:
                self._arrays.move_to_end(key)
            return arrays

    def holds(self, key: Hashable) -> bool:
        """Whether there is something under `key`."""
        with self._lock:
            return key in self._arrays

    def drop(self, key: Hashable) -> None:
        """Forget what is stored under `key`, if anything."""
        with self._lock:
            self._bytes -= sum(array.nbytes for array in self._arrays.pop(key, ()))

    def put(self, key: Hashable, *arrays: np.ndarray) -> None:
        """Keep arrays under `key`, pushing out the least recently used ones where they do not fit."""
        size = sum(array.nbytes for array in arrays)
        with self._lock:
            old = self._arrays.pop(key, None)
            if old is not None:
                self._bytes -= sum(array.nbytes for array in old)
            if size > self.limit:
                return
            while self._arrays and self._bytes + size > self.limit:
                _, gone = self._arrays.popitem(last=False)
                self._bytes -= sum(array.nbytes for array in gone)
            self._arrays[key] = arrays
            self._bytes += size
