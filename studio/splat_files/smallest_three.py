"""Rotations of which a file stores three components: the one of largest magnitude follows from the unit length."""

from __future__ import annotations

import numpy as np


def quats_of_three(stored: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """Unit quaternions.

    Args:
        stored: (N, 3), the other components in their order.
        largest: (N,) index of the component that is not stored, 0 to 3; it is positive.

    Returns:
        (N, 4), in the order of the file's components.
    """
    quats = np.empty((len(stored), 4))
    for index in range(4):
        chosen = largest == index
        others = [component for component in range(4) if component != index]
        quats[np.ix_(chosen, others)] = stored[chosen]
        quats[chosen, index] = np.sqrt(np.maximum(0, 1 - (stored[chosen] ** 2).sum(axis=1)))
    return quats
