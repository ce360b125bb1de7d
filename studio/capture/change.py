"""Change of a performer's appearance between two frames, independent of position and size in the image.

A new group of frames should start where the splats of the keyframe no longer fit because limbs have moved or the
performer has turned. Both change what the cameras see, even after position and size are normalized.
"""

import cv2
import numpy as np

LOOK_SIDE = 32
_MARGIN = 1.2
_MIN_PIXELS = 16
"""Minimum number of foreground pixels; images with fewer contain too little information."""


def look(image: np.ndarray, mask: np.ndarray, side: int = LOOK_SIDE) -> np.ndarray | None:
    """A thumbnail of the performer, scaled to fill it: (side, side, 4) float32, color times mask, and mask; or None."""
    inside = mask > 127
    if int(inside.sum()) < _MIN_PIXELS:
        return None
    rows, columns = np.nonzero(inside)
    extent = max(int(np.ptp(rows)), int(np.ptp(columns)), 1) * _MARGIN
    scale = side / extent
    transform = np.array(
        [[scale, 0, side / 2 - columns.mean() * scale], [0, scale, side / 2 - rows.mean() * scale]], np.float32
    )
    weight = mask.astype(np.float32)[..., None] / 255
    layered = np.dstack([image.astype(np.float32) / 255 * weight, weight])
    blur = max(1, round(1 / scale))  # footprint of a thumbnail pixel
    return cv2.warpAffine(cv2.blur(layered, (blur, blur)), transform, (side, side), flags=cv2.INTER_LINEAR)


def change(before: np.ndarray, after: np.ndarray) -> float:
    """Difference of two results of `look`: 0 for equal thumbnails, 1 for no overlap."""
    both = float(np.maximum(before, after).sum())
    return float(np.abs(before - after).sum()) / both if both > 0 else 0.0
