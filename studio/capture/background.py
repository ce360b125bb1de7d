"""The empty set, from footage in which something moves before it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np


def background_plate(read: Callable[[int], np.ndarray], frames: Sequence[int], samples: int = 31) -> np.ndarray:
    """Per-pixel temporal median of frames spread evenly over the footage.

    Args:
        read: gives (H, W, 3) uint8 RGB of a frame.
        frames: frame numbers to choose from.
        samples: how many to use at most (memory: samples x H x W x 3 bytes).

    Returns:
        (H, W, 3) uint8 RGB.
    """
    count = min(samples, len(frames))
    chosen = [frames[round(index)] for index in np.linspace(0, len(frames) - 1, count)]
    stack = np.stack([read(frame) for frame in chosen])
    plate = np.empty(stack.shape[1:], np.uint8)
    for top in range(0, stack.shape[1], 64):  # in strips: np.median works on a float copy
        plate[top : top + 64] = np.rint(np.median(stack[:, top : top + 64], axis=0)).astype(np.uint8)
    return plate
