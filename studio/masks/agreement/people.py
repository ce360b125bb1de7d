"""Evidence of a matting model for each person, who is shown to it enlarged, not small in a whole image."""

from collections.abc import Callable

import numpy as np

_SMALLEST = 0.05
"""Share of the performer's area below which a part is not looked at."""
_MARGINS = (0.15, 0.02)
"""Around a person, as fractions of the longer side: a look at what `solid` may lack, and one with more pixels."""
_APART = 1 / 160
"""Gap up to which parts are one person, as a fraction of the image's longer side."""
_CLIP = 0.02
"""How close to 0 and 1 a model may be."""


def odds_of_people(image: np.ndarray, solid: np.ndarray, model: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Log-odds of a model that gets square parts of an image (H, W, 3) uint8 RGB for each person: (H, W) float32, the
    mean of those that show a pixel, 0 in no part. `solid`: (h, w) bool, roughly where the performer is, at any size;
    `model`: returns masks (N, N) in 0..1 of images (N, N, 3) uint8 RGB."""
    import cv2

    height, width = image.shape[:2]
    solid = cv2.resize(solid.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    reach = 1 + round(_APART * max(height, width))
    _, labels, _, _ = cv2.connectedComponentsWithStats(cv2.dilate(solid, np.ones((2 * reach + 1,) * 2, np.uint8)))
    labels *= solid
    areas = np.bincount(labels.ravel())[1:]
    people = np.flatnonzero(areas > _SMALLEST * areas.sum()) + 1
    boxes = [cv2.boundingRect((labels == label).astype(np.uint8)) for label in people]
    total, looks = np.zeros((2, height, width), np.float32)
    for margin in _MARGINS:
        share = np.full((height, width), -1.0, np.float32)
        for left, top, across, down in boxes:
            half = round((0.5 + margin) * max(across, down))
            framed = cv2.copyMakeBorder(image, half, half, half, half, cv2.BORDER_REPLICATE)
            row, column = top + down // 2, left + across // 2  # of the square's corner, in the framed image
            odds = np.full(framed.shape[:2], -1.0, np.float32)
            square = slice(row, row + 2 * half), slice(column, column + 2 * half)
            odds[square] = model(np.ascontiguousarray(framed[square]))
            np.maximum(share, odds[half:-half, half:-half], out=share)
        clipped = np.clip(share, _CLIP, 1 - _CLIP)
        total += np.where(share < 0, np.float32(0), np.log(clipped / (1 - clipped)))
        looks += share >= 0
    return np.asarray(total / np.maximum(looks, 1))
