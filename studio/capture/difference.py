"""A soft foreground matte from an image and the same view of the empty set."""

from __future__ import annotations

import numpy as np


def noise_of(difference: np.ndarray) -> np.ndarray:
    """Robust standard deviation of each channel of an image difference, taken as if most pixels were background.

    Args:
        difference: (H, W, C) float32.

    Returns:
        (C,) float32, at least 0.5 (8-bit rounding and compression).
    """
    flat = difference.reshape(-1, difference.shape[-1])[::7]
    center = np.median(flat, axis=0)
    return np.maximum(1.4826 * np.median(np.abs(flat - center), axis=0), 0.5).astype(np.float32)


def difference_matte(image: np.ndarray, plate: np.ndarray, sensitivity: float = 1.0, components: int = 0) -> np.ndarray:
    """Foreground matte of `image` by comparison with `plate`.

    Args:
        image: (H, W, 3) uint8 RGB.
        plate: (H, W, 3) uint8 RGB, the same view without the performer.
        sensitivity: above 1 finds more foreground, below 1 less.
        components: how many foreground pieces to keep, largest first; 0 keeps all that are larger than noise.

    Returns:
        (H, W) uint8, 255 foreground, soft at the edges.
    """
    import cv2

    height, width = image.shape[:2]
    unit = max(1.0, max(height, width) / 1000.0)
    blur = 0.8 * unit
    smooth_image = cv2.GaussianBlur(image.astype(np.float32), (0, 0), blur)
    smooth_plate = cv2.GaussianBlur(plate.astype(np.float32), (0, 0), blur)
    difference = cv2.cvtColor(smooth_image / 255.0, cv2.COLOR_RGB2YCrCb) - cv2.cvtColor(
        smooth_plate / 255.0, cv2.COLOR_RGB2YCrCb
    )
    difference *= 255.0
    difference -= np.median(difference.reshape(-1, 3)[::7], axis=0)
    score = np.sqrt(((difference / noise_of(difference)) ** 2).sum(-1)) * sensitivity
    sure, maybe = score > 9.0, score > 4.5
    count, labels = cv2.connectedComponents(maybe.astype(np.uint8), connectivity=8)
    keep = np.zeros(count, bool)
    keep[np.unique(labels[sure])] = True
    keep[0] = False
    mask = keep[labels].astype(np.uint8)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel)
    mask = keep_components(mask, components, minimum=int(2e-4 * height * width))
    return cv2.GaussianBlur(mask * np.uint8(255), (0, 0), 0.6 * unit)


def keep_components(mask: np.ndarray, components: int, minimum: int) -> np.ndarray:
    """The largest connected pieces of a binary mask, none below `minimum` pixels; holes below it are filled.

    Args:
        mask: (H, W) uint8, 0 or 1.
        components: how many pieces to keep; 0 is any number.
        minimum: pixels.
    """
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    order = 1 + np.argsort(-areas, kind="stable")
    keep = np.zeros(count, np.uint8)
    keep[[label for label in order[: components or None] if stats[label, cv2.CC_STAT_AREA] >= minimum]] = 1
    mask = keep[labels]
    count, labels, stats, _ = cv2.connectedComponentsWithStats(1 - mask, connectivity=4)
    holes = stats[:, cv2.CC_STAT_AREA] < minimum
    holes[0] = False
    mask[holes[labels]] = 1
    return mask
