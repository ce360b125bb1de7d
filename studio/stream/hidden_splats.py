"""Splats that are too faint to be drawn in a frame move with their surroundings.

Nothing in training stops such splats: they have no gradients. Where they have strayed from the performer, the video's
coding error can make them opaque enough to be seen, and their paths cost bits.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from studio.rasterizer.types import ALPHA_MIN


def carry_hidden_splats(positions: np.ndarray, opacities: np.ndarray) -> np.ndarray:
    """Move splats that a frame does not draw like the drawn splat that is nearest in the keyframe.

    Args:
        positions: (F, N, 3) means, keyframe first, world units.
        opacities: (F, N), 0 to 1.

    Returns:
        (F, N, 3) means: those of drawn splats and of the keyframe are unchanged. `positions` itself if nothing changes.
    """
    carried = positions
    for frame in range(1, len(positions)):
        hidden = opacities[frame] < ALPHA_MIN
        if not hidden.any() or hidden.all():
            continue
        if carried is positions:
            carried = positions.copy()
        drawn = np.flatnonzero(~hidden)
        nearest = drawn[cKDTree(positions[0, drawn]).query(positions[0, hidden])[1]]
        carried[frame, hidden] = positions[0, hidden] + positions[frame, nearest] - positions[0, nearest]
    return carried
