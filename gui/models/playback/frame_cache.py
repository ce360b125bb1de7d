"""A cache of decoded frames."""

from __future__ import annotations

import threading
from collections import OrderedDict

from studio.gaussians import Gaussians

CACHE_BYTES = 512 * 1024 * 1024
AHEAD = 4
"""Number of frames decoded ahead of the one on screen."""


class FrameCache:
    """The most recently used frames, up to a number of bytes, but always a few. Thread-safe."""

    def __init__(self, limit: int = CACHE_BYTES) -> None:
        self._limit = limit
        self._frames: OrderedDict[int, tuple[Gaussians, int]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, frame: int) -> Gaussians | None:
        """The frame; None if it is not cached."""
        with self._lock:
            if frame not in self._frames:
                return None
            self._frames.move_to_end(frame)
            return self._frames[frame][0]

    def has(self, frame: int) -> bool:
        """Whether the frame is cached; does not count as a use."""
        with self._lock:
            return frame in self._frames

    def put(self, frame: int, gaussians: Gaussians) -> None:
        """Add a frame; the least recently used ones are evicted if there is no room."""
        size = sum(tensor.numel() * tensor.element_size() for _, tensor in gaussians.items())
        with self._lock:
            self._frames[frame] = (gaussians, size)
            self._frames.move_to_end(frame)
            while len(self._frames) > AHEAD + 2 and sum(held for _, held in self._frames.values()) > self._limit:
                self._frames.popitem(last=False)

    @property
    def held(self) -> int:
        """Bytes of the frames in the cache."""
        with self._lock:
            return sum(size for _, size in self._frames.values())

    def clear(self) -> None:
        """Empty the cache."""
        with self._lock:
            self._frames.clear()
