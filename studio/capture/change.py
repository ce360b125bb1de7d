"""How much the performer has changed between two moments, from a few small pictures: where he stands does not count.

A new group of frames should begin where the splats of the keyframe no longer fit: limbs have swung, he has turned. Both
change what cameras see of him, once his place in the picture is taken out.
"""

from __future__ import annotations

import cv2
import numpy as np

LOOK_SIDE = 32
_MARGIN = 1.2
_FEWEST = 16
"""Pixels of the mask below which a picture says nothing."""


def look(image: np.ndarray, matte: np.ndarray, side: int = LOOK_SIDE) -> np.ndarray | None:
    """A small picture of the performer, centered and scaled to his size.

    Args:
        image: (H, W, 3) uint8 RGB.
        matte: (H, W) uint8, 255 foreground.
        side: of the result, pixels.

    Returns:
        (side, side, 4) float32 in 0 to 1, color times matte, and matte; None where he is not seen.
    """
    inside = matte > 127
    if int(inside.sum()) < _FEWEST:
        return None
    rows, columns = np.nonzero(inside)
    extent = max(int(np.ptp(rows)), int(np.ptp(columns)), 1) * _MARGIN
    scale = side / extent
    place = np.array(
        [[scale, 0, side / 2 - columns.mean() * scale], [0, scale, side / 2 - rows.mean() * scale]], np.float32
    )
    weight = matte.astype(np.float32)[..., None] / 255
    layered = np.dstack([image.astype(np.float32) / 255 * weight, weight])
    blur = max(1, round(1 / scale))  # what the small pixels average over
    return cv2.warpAffine(cv2.blur(layered, (blur, blur)), place, (side, side), flags=cv2.INTER_LINEAR)


def change(before: np.ndarray, after: np.ndarray) -> float:
    """0 for the same picture, 1 where nothing of one lies on anything of the other; of two results of `look`."""
    both = float(np.maximum(before, after).sum())
    return float(np.abs(before - after).sum()) / both if both > 0 else 0.0
