"""A cache of decoded frames."""

from studio.gaussians import Gaussians
from studio.memory_cache import MemoryCache

CACHE_BYTES = 512 * 1024 * 1024
AHEAD = 4  # number of frames decoded ahead of the one on screen


def frame_cache(limit: int = CACHE_BYTES) -> MemoryCache[int, Gaussians]:
    """The most recently used frames, up to a number of bytes, but always a few."""
    return MemoryCache(limit, bytes_of_frame, least=AHEAD + 2)


def bytes_of_frame(gaussians: Gaussians) -> int:
    return sum(tensor.numel() * tensor.element_size() for _, tensor in gaussians.items())
