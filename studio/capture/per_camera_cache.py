"""One value per camera, computed once on demand."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class PerCameraCache(Generic[T]):
    """Thread safe: each camera's value is computed once, and cameras do not wait for each other.

    If the computation raises, the next call tries again.
    """

    def __init__(self, make: Callable[[str], T]) -> None:
        """`make`: computes the value from a camera's name."""
        self._make = make
        self._values: dict[str, T] = {}
        self._locks: dict[str, threading.Lock] = {}
        self._lock = threading.Lock()

    def __call__(self, camera: str) -> T:
        """The value of `camera`. Raises what `make` raises."""
        with self._lock:
            lock = self._locks.setdefault(camera, threading.Lock())
        with lock:
            if camera not in self._values:
                self._values[camera] = self._make(camera)
            return self._values[camera]
