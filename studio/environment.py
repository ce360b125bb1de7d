"""Environment variables of a process that trains. Entry points set them; importing `studio` changes nothing."""

from __future__ import annotations

import os


def passive_openmp() -> None:
    """Set OMP_WAIT_POLICY=passive unless it is set already. Call this before torch is imported.

    By default OpenMP threads spin while they wait, so when another process uses the same cores, every small torch
    operation waits for a whole time slice: a training step on two busy cores took 787 ms with spinning, 42 ms without.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
