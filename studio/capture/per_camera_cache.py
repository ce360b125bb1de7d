"""What is made once a camera, when first asked for, and then kept."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class PerCameraCache(Generic[T]):
    """Thread safe; cameras do not wait for each other. What raised is tried again next time."""

    def __init__(self, make: Callable[[str], T]) -> None:
        """`make`: from a camera's name to the thing."""
        self._make = make
        self._made: dict[str, T] = {}
        self._locks: dict[str, threading.Lock] = {}
        self._lock = threading.Lock()

    def __call__(self, camera: str) -> T:
        """The camera's."""
        with self._lock:
            lock = self._locks.setdefault(camera, threading.Lock())
        with lock:
            if camera not in self._made:
                self._made[camera] = self._make(camera)
            return self._made[camera]
