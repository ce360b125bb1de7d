"""Environment variables of a process that trains. Entry points set them; importing `studio` changes nothing."""

from __future__ import annotations

import os
import platform

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
"""Parameters of mallopt(3), from malloc.h."""
_MOST_POOLED, _MOST_KEPT = 2**25, 2**28
"""Bytes: blocks above the first are still returned at once; the second is what a pool keeps."""


def passive_openmp() -> None:
    """Set OMP_WAIT_POLICY=passive unless it is already set. Call this before torch is imported.

    By default, OpenMP threads spin while they wait. If another process uses the same cores, each small torch operation
    then waits for a whole time slice: a training step on two busy cores took 787 ms with spinning and 42 ms without.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")


def keep_freed_memory() -> None:
    """Let the C library keep freed memory for the next arrays, instead of returning it to the system.

    By default, glibc returns large blocks at once, and each new array costs a page fault per 4 KiB: half of the time of
    a mask, and a part of each training step. Up to 256 MiB per pool of the C library are kept. Without glibc, and if
    the environment sets one of its MALLOC variables, this does nothing.
    """
    import ctypes

    if platform.libc_ver()[0] != "glibc" or any(name.startswith("MALLOC_") for name in os.environ):
        return
    mallopt = ctypes.CDLL(None).mallopt
    mallopt(_M_MMAP_THRESHOLD, _MOST_POOLED)
    mallopt(_M_TRIM_THRESHOLD, _MOST_KEPT)
