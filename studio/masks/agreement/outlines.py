"""Outlines of the performer in each image, from log-odds and from colors that the cameras share."""

import numpy as np

from v3studio.studio.masks.filters import color_table

CERTAIN = 2.5
"""Log-odds beyond which a pixel is not up for decision."""
_SHARED = 3000
"""Samples of the performer's colors from all cameras, at least, for each camera."""
BINS = 24
"""Number of bins of colors, per channel."""
_NEAR = 20
"""Pixels around the performer where colors of the set count more."""
_TELLING = 0.5
"""Median of `color_odds` on the performer, below which colors say nothing about outlines."""
_FEWEST = 50
"""Pixels of performer and set, below which there is nothing to learn colors from."""


def color_odds(bins: np.ndarray, odds: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Return how much more frequent each pixel's color is on the performer than on the set: (H, W) float32 log ratio,
    -3 to 3, from the `color_bins` (H, W) int32 of an image, the log-odds (H, W) float32 of the performer, and the
    performer's bins (N,) int32 in all cameras."""
    import cv2

    own, behind = bins[odds > 0.5], odds < -0.5
    reach = np.ones((2 * _NEAR + 1, 2 * _NEAR + 1), np.uint8)
    near = bins[behind & (cv2.dilate((odds > 0).astype(np.uint8), reach) > 0)]
    some = shared[:: max(1, len(shared) // max(len(own), _SHARED))]
    front = np.concatenate([own, own, some])
    back = np.concatenate([bins[behind][::4], near, near])
    if min(len(front), len(back)) < _FEWEST:
        return np.zeros(bins.shape, np.float32)
    table = color_table(front, back, BINS, floor=2e-5)
    return np.asarray(cv2.blur(np.clip(table, -3.0, 3.0).reshape(-1)[bins], (3, 3)))


def cut(image: np.ndarray, odds: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """GrabCut (Rother, Kolmogorov and Blake, SIGGRAPH 2004) of an (H, W, 3) uint8 RGB image that starts from log-odds
    (H, W) float32: (H, W) bool. If the performer has the colors of the set, as `color_odds` says in `colors` (H, W), it
    is where the log-odds are positive."""
    import cv2

    result = odds > 0
    if not result.any() or np.median(colors[result]) < _TELLING:
        return result
    labels = np.where(result, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[odds > CERTAIN], labels[odds < -CERTAIN] = cv2.GC_FGD, cv2.GC_BGD
    around = cv2.dilate((odds > -CERTAIN).astype(np.uint8), np.ones((2 * _NEAR + 1, 2 * _NEAR + 1), np.uint8))
    count, parts, stats, _ = cv2.connectedComponentsWithStats(around)
    left, top, width, height = cv2.boundingRect(around)
    few = slice(top, top + height, 2), slice(left, left + width, 2)  # enough to learn colors from
    part = np.ascontiguousarray(labels[few])
    inside = int((part & 1).sum())
    if min(inside, part.size - inside) < _FEWEST // 2:
        return result
    cv2.setRNGSeed(0)
    front, back = np.zeros((1, 65)), np.zeros((1, 65))
    pixels, whole = np.ascontiguousarray(image[few]), (0, 0, 1, 1)
    cv2.grabCut(pixels, part, whole, back, front, 1, cv2.GC_INIT_WITH_MASK)
    for label in range(1, count):
        left, top, width, height = stats[label, :4]
        place = slice(top, top + height), slice(left, left + width)
        part, pixels = np.ascontiguousarray(labels[place]), np.ascontiguousarray(image[place])
        cv2.grabCut(pixels, part, whole, back, front, 1, cv2.GC_EVAL_FREEZE_MODEL)
        result[place] = np.where(parts[place] == label, (part & 1) > 0, result[place])
    return result
