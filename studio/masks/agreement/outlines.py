"""Outlines of the performer in each image, from log-odds and from colors that the cameras share."""

from collections.abc import Mapping

import numpy as np

from studio.masks.filters import color_table, look_up

CERTAIN = 2.5
"""Log-odds beyond which a pixel is not up for decision."""
_ROUNDS = 1  # of GrabCut, which is called several times
_SHARED = 3000
"""Samples of the performer's colors from all cameras, at least, for each camera."""
_NEAR = 20
"""Pixels around the performer where colors of the set count more."""
_TELLING = 0.5
"""Median of `color_odds` on the performer, below which colors say nothing about outlines."""
_FEWEST = 50
"""Pixels of performer and set, below which there is nothing to learn colors from."""


def color_odds(images: Mapping[str, np.ndarray], odds: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """How much more frequent each pixel's color is on the performer than on the set: log ratio, -3 to 3."""
    import cv2

    shared = np.concatenate([images[name][odds[name] > 2.0] for name in images])
    reach = np.ones((2 * _NEAR + 1, 2 * _NEAR + 1), np.uint8)
    result = {}
    for name, image in images.items():
        own, behind = image[odds[name] > 0.5], odds[name] < -0.5
        near = behind & (cv2.dilate((odds[name] > 0).astype(np.uint8), reach) > 0)
        some = shared[:: max(1, len(shared) // max(len(own), _SHARED))]
        front = np.concatenate([own, own, some])
        back = np.concatenate([image[behind][::4], image[near], image[near]])
        if min(len(front), len(back)) < _FEWEST:
            result[name] = np.zeros(image.shape[:2], np.float32)
            continue
        table = color_table(front, back, bins=24, floor=2e-5)
        result[name] = cv2.blur(np.clip(look_up(table, image), -3.0, 3.0), (3, 3))
    return result


def cut(image: np.ndarray, odds: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """GrabCut (Rother, Kolmogorov and Blake, SIGGRAPH 2004) that starts from log-odds.

    Args:
        image: (H, W, 3) uint8 RGB.
        odds: (H, W) float32 log-odds of the performer.
        colors: (H, W) float32, what `color_odds` says of them.

    Returns:
        (H, W) bool; where the log-odds are positive if the performer has the colors of the set.
    """
    import cv2

    labels = np.where(odds > 0, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[odds > CERTAIN], labels[odds < -CERTAIN] = cv2.GC_FGD, cv2.GC_BGD
    left, top, width, height = cv2.boundingRect((odds > -CERTAIN).astype(np.uint8))
    rows = slice(max(0, top - _NEAR), top + height + _NEAR)
    columns = slice(max(0, left - _NEAR), left + width + _NEAR)
    part = np.ascontiguousarray(labels[rows, columns])
    inside = int((part & 1).sum())
    if inside < _FEWEST or part.size - inside < _FEWEST or np.median(colors[odds > 0]) < _TELLING:
        return odds > 0
    pixels = np.ascontiguousarray(image[rows, columns])
    cv2.setRNGSeed(0)
    front, back = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(pixels, part, (0, 0, 1, 1), back, front, _ROUNDS, cv2.GC_INIT_WITH_MASK)
    labels[rows, columns] = part
    return (labels & 1) > 0
