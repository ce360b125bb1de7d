"""Gives memory that has been freed back to the system.

With dozens of threads, which decode and render, glibc keeps what they freed in up to eight heaps per core.
"""

import ctypes


def give_back() -> bool:
    """Return unused pages of all heaps to the system (glibc's malloc_trim); returns whether there were any. Without
    glibc, does nothing."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    return trim is not None and bool(trim(ctypes.c_size_t(0)))
