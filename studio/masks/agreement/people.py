"""Evidence of a matting model for each person, who is shown to it enlarged, not small in a whole image."""

import math
from collections.abc import Callable, Sequence

import numpy as np

_SMALLEST = 0.05
"""Share of the performer's area below which a part is not looked at."""
_MARGINS = (0.15, 0.02)
"""Around a person, as fractions of the longer side: a look at what `solid` may lack, and one with more pixels."""
_TILES = (1.0, 0.6)
"""Sides of squares in which people are searched, in fractions of the image's shorter side."""
_APART = 1 / 160
"""Gap up to which parts are one person, as a fraction of the image's longer side."""
_CLIP = 0.02
"""How close to 0 and 1 a model may be."""
_LEAST_SEEN = 0.3
"""Share of the performer that a model must see for it to know what they are."""
_DARK, _BRIGHTEST = 0.35, 0.5
"""Median of an image below which it is brightened for a model, and the least exponent: models are trained on well lit
photographs, and lose black hair before a black wall."""

Square = tuple[int, int, int]
"""Row and column of the center, and half of the side, in pixels."""
Look = Callable[[np.ndarray], np.ndarray]
"""Returns masks (N, N) in 0..1 of images (N, N, 3) uint8 RGB."""


def odds_of_people(image: np.ndarray, solid: np.ndarray, model: Look) -> np.ndarray:
    """Log-odds of a model that gets square parts of an image (H, W, 3) uint8 RGB for each person: (H, W) float32, the
    mean of those that show a pixel, 0 in no part. `solid`: (h, w) bool, roughly where the performer is, at any size."""
    import cv2

    height, width = image.shape[:2]
    solid = cv2.resize(solid.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    reach = 1 + round(_APART * max(height, width))
    _, labels, _, _ = cv2.connectedComponentsWithStats(cv2.dilate(solid, np.ones((2 * reach + 1,) * 2, np.uint8)))
    labels *= solid
    areas = np.bincount(labels.ravel())[1:]
    people = np.flatnonzero(areas > _SMALLEST * areas.sum()) + 1
    boxes = [cv2.boundingRect((labels == label).astype(np.uint8)) for label in people]
    looks = [
        [
            (top + down // 2, left + across // 2, max(1, round((0.5 + margin) * max(across, down))))
            for left, top, across, down in boxes
        ]
        for margin in _MARGINS
    ]
    return _seen(image, looks, model)


def odds_of_tiles(image: np.ndarray, model: Look) -> np.ndarray:
    """As `odds_of_people`, where nobody has been found yet: with squares all over the image."""
    looks = []
    for share in _TILES:
        half = max(1, round(0.5 * share * min(image.shape[:2])))
        rows, columns = (
            np.linspace(half, side - half, max(1, 1 + int(np.ceil((side - 2 * half) / half)))).astype(int)
            for side in image.shape[:2]
        )
        looks.append([(int(row), int(column), half) for row in rows for column in columns])
    return _seen(image, looks, model)


def sees_people(odds: Sequence[np.ndarray], solid: Sequence[np.ndarray]) -> bool:
    """Whether a model's log-odds of some images say that the performers `solid` (H, W) bool are people."""
    seen = sum(int(((mine > 0) & there).sum()) for mine, there in zip(odds, solid, strict=True))
    return seen > _LEAST_SEEN * sum(int(there.sum()) for there in solid)


def _seen(image: np.ndarray, looks: Sequence[Sequence[Square]], model: Look) -> np.ndarray:
    """Mean log-odds of several looks at an image, each the most of what its squares show."""
    import cv2

    height, width = image.shape[:2]
    total, count = np.zeros((2, height, width), np.float32)
    for squares in looks:
        share = np.full((height, width), -1.0, np.float32)
        for row, column, half in squares:
            framed = cv2.copyMakeBorder(image, half, half, half, half, cv2.BORDER_REPLICATE)
            odds = np.full(framed.shape[:2], -1.0, np.float32)
            square = slice(row, row + 2 * half), slice(column, column + 2 * half)  # in the framed image
            odds[square] = model(_lit(np.ascontiguousarray(framed[square])))
            np.maximum(share, odds[half:-half, half:-half], out=share)
        clipped = np.clip(share, _CLIP, 1 - _CLIP)
        total += np.where(share < 0, np.float32(0), np.log(clipped / (1 - clipped)))
        count += share >= 0
    return np.asarray(total / np.maximum(count, 1))


def _lit(image: np.ndarray) -> np.ndarray:
    """An image (H, W, 3) uint8 as a model sees it best: a dark one is brightened."""
    median = max(float(np.median(image)) / 255, 0.01)
    if median >= _DARK:
        return image
    exponent = max(_BRIGHTEST, math.log(_DARK) / math.log(median))
    table = 255 * (np.arange(256) / 255) ** exponent
    return np.asarray(np.round(table).astype(np.uint8)[image])
