"""The empty set again, once cameras agree where the performer is.

A set that one camera estimates from its footage shows a performer who stands still, and looks reliable there. The masks
on which all cameras agree have the performer nevertheless: outside of these masks in several frames, there is the set.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from v3studio.studio.masks.clean_plate import Background

_CLOSED, _GROWN = 1 / 40, 1 / 160
"""Radii by which masks are closed and grown, as fractions of the longer side: missing parts are near others."""


def cover(solid: np.ndarray) -> np.ndarray:
    """(h, w) bool: where the performer may be, from their mask (h, w) bool."""
    import cv2

    longer = max(solid.shape)
    closed, grown = (
        cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        for radius in (max(1, round(part * longer)) for part in (_CLOSED, _GROWN))
    )
    margin = longer // 8
    framed = cv2.copyMakeBorder(solid.astype(np.uint8), margin, margin, margin, margin, cv2.BORDER_REPLICATE)
    framed = cv2.dilate(cv2.morphologyEx(framed, cv2.MORPH_CLOSE, closed), grown)
    return framed[margin:-margin, margin:-margin] > 0


def uncovered(behind: Background, images: Sequence[np.ndarray], covers: Sequence[np.ndarray]) -> Background:
    """The set, estimated again from images whose performer may be in `covers`; elsewhere it stays as it was."""
    median, count = median_outside(images, covers)
    some = count > 0
    again = some & (count < len(images))
    known = np.ones_like(some) if behind.known is None else behind.known
    doubtful = np.zeros_like(some) if behind.doubtful is None else behind.doubtful
    return replace(
        behind,
        plate=np.where(again[..., None], median, behind.plate).astype(np.uint8),
        known=known | again,
        doubtful=(doubtful | ~some) & ~again,
        agreed=some & (known | again),
    )


def median_outside(images: Sequence[np.ndarray], covers: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The median, (H, W, 3) uint8, of images (H, W, 3) uint8 outside of their `covers` (h, w) bool, 255 where all are
    covered; and how many are not, (H, W)."""
    import cv2

    height, width = images[0].shape[:2]
    hidden = np.stack(
        [cv2.resize(cover.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0 for cover in covers]
    )
    count = (~hidden).sum(0)
    middle = np.maximum(count - 1, 0) // 2
    median = np.empty(images[0].shape, np.uint8)
    for top in range(0, height, 64):  # in strips, since sorting makes copies; int16 sorts faster than uint8
        rows = slice(top, top + 64)
        samples = np.where(hidden[:, rows, :, None], np.int16(255), np.stack([image[rows] for image in images]))
        samples.sort(axis=0)  # hidden ones last
        median[rows] = np.take_along_axis(samples, middle[None, rows, :, None], 0)[0]
    return median, count
