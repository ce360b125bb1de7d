"""Environment variables of a process that trains. Entry points set them; importing `studio` changes nothing."""

from __future__ import annotations

import os


def passive_openmp() -> None:
    """Set OMP_WAIT_POLICY=passive unless it is already set. Call this before torch is imported.

    By default, OpenMP threads spin while they wait. If another process uses the same cores, each small torch operation
    then waits for a whole time slice: a training step on two busy cores took 787 ms with spinning and 42 ms without.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
