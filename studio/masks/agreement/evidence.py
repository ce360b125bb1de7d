"""Evidence for the performer in a single image, before cameras are compared: log-odds per pixel.

Before a clean plate, the difference from it is all the evidence. Before a set that was estimated from the footage,
three clues are added. Where nothing has moved for a moment, connected to most of the image, there is the set. A pixel
that equals the empty set up to the noise shows the set, and so does a color that occurs in the set only. Where cameras
have agreed that an estimated set is empty, differences count in full. The weights were fitted by logistic regression to
masks of two frames of real footage (27 cameras), and rounded.
"""

from collections.abc import Sequence

import numpy as np

from v3studio.studio.capture.settings import DifferenceSettings
from v3studio.studio.masks.chroma_key import key_evidence
from v3studio.studio.masks.clean_plate import Background, difference_evidence, match_exposure
from v3studio.studio.masks.filters import brightness, guided_filter, odds_of_colors
from v3studio.studio.masks.screen_color import Screen

LIMIT = 4.0
"""Log-odds of single images are clipped to this: any of them may be wrong."""
_PRIOR, _STILL = 2.5, -4.0
"""Log-odds of a pixel that has moved, and a term that is added where nothing has moved."""
_EQUAL, _SET_COLOR, _NOISE = 0.45, 1.0, 0.9
"""Weights of the difference from the plate where it is small, of colors of the set, and of the difference in units of
the noise."""
_AGREED = (2.2, 1.9, 1.4)
"""Log-odds before a set on which cameras agree; weights of the difference, also in units of the noise."""
_DIFFERENT = 2.0
"""Log-odds of the difference from the plate, above which a pixel without motion may show a performer who rests."""
_MOVED = 0.7
"""Natural logarithm of the difference in units of the noise, from which a pixel counts as moved."""
_SOLID = 0.02
"""Least width of a part of a screen, as a fraction of the longer side: less may be something else of its color."""
_SHADED, _TURNED, _DULL, _DARKEST = -3.0, 0.1, 0.25, 0.2
"""Log-odds of a shadow on a saturated set; sines of the angle by which a shadow may change the color, and of the one
from gray from which on a set is saturated; and the least share of light in a shadow."""
_CONNECTED = 0.1
"""Still areas below this fraction of the image may be enclosed by a performer who moves."""


def evidence_of(
    image: np.ndarray, neighbors: Sequence[np.ndarray], behind: Background, settings: DifferenceSettings
) -> np.ndarray:
    """Log-odds that pixels of an (H, W, 3) uint8 RGB image show the performer: (H, W) float32, within +-`LIMIT`.
    `neighbors`: the images shortly before and after, maybe none; `behind`: the set, of the same size."""
    ours, empty = image.astype(np.float32), behind.plate.astype(np.float32)
    known, doubtful = behind.known, behind.doubtful
    empty *= match_exposure(ours, empty, known)
    difference = difference_evidence(ours, empty, settings)
    if settings.mask_shadows != "none":
        shade = _shade(ours, empty)
        difference += shade * (_SHADED - np.maximum(difference, _SHADED))
    if known is None or doubtful is None:  # a plate that is known to be empty needs no other clue
        return smoothed(brightness(image), np.clip(difference, -LIMIT, LIMIT))
    own = _features(image)
    noise = np.clip(_in_noise([own - _features(np.clip(empty, 0, 255).astype(np.uint8))]), -0.5, 2.0)
    constant, differs, noisy = _AGREED
    sure = constant + differs * np.clip(difference, -LIMIT, LIMIT) + noisy * noise
    colors = np.zeros_like(difference)
    if behind.colors is not None:
        colors = odds_of_colors(behind.colors, ours, 3.0)
        # Where the plate looks more like the performer than the image does, the plate is wrong.
        difference[(odds_of_colors(behind.colors, empty, 3.0) - colors > 1.0) & (difference > 0.0)] = 0.0
    equal = np.clip(difference, -1.0, 0.0)
    equal[~known] = 0.0
    equal[doubtful] = np.maximum(equal[doubtful], -0.5)
    total = _PRIOR + 4 * _EQUAL * equal + _SET_COLOR * np.minimum(colors, 0.0) + _NOISE * noise
    if neighbors:
        still = _still(_in_noise([own - _features(other) for other in neighbors]))
        total += _STILL * (still & (difference < _DIFFERENT))
    if behind.agreed is not None:
        total = np.where(behind.agreed, sure, total)
    return smoothed(brightness(image), np.clip(total, -LIMIT, LIMIT).astype(np.float32))


def evidence_of_screen(image: np.ndarray, screen: Screen, settings: DifferenceSettings) -> np.ndarray:
    """Log-odds that pixels of an (H, W, 3) uint8 RGB image show the performer: (H, W) float32, within +-`LIMIT`. Other
    colors say nothing unless the screen is on both sides: beyond its edge is the set, too."""
    import cv2

    odds = key_evidence(image.astype(np.float32), screen, settings)
    odds = smoothed(brightness(image), np.clip(odds, -LIMIT, LIMIT))
    width = max(3, round(_SOLID * max(image.shape[:2])))
    solid = cv2.morphologyEx((odds < 0).astype(np.uint8), cv2.MORPH_OPEN, np.ones((width, width), np.uint8))
    left = np.maximum.accumulate(solid, axis=1)
    right = np.maximum.accumulate(solid[:, ::-1], axis=1)[:, ::-1]
    between = cv2.blur((left & right).astype(np.float32), (width, width))
    return np.where(odds > 0, odds * between, odds)


def smoothed(gray: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(H, W) float32 `values`, smoothed along the edges of the image of that `brightness`."""
    return guided_filter(gray, values, radius=3)


def _shade(ours: np.ndarray, empty: np.ndarray) -> np.ndarray:
    """(H, W) float32 in 0..1, 1 where an image (H, W, 3) float32 has the hue of a saturated set `empty` with less
    light: shadows at the feet on a carpet, which are too dark and too small for `difference_evidence`."""
    import cv2

    ones = np.ones((1, 3), np.float32)
    mine, theirs = (cv2.GaussianBlur(pixels, (0, 0), 1.0) for pixels in (ours, empty))
    light, most, both = (
        cv2.transform(first * second, ones) for first, second in ((mine, mine), (theirs, theirs), (mine, theirs))
    )
    gray = cv2.transform(theirs, ones / 3)
    colorful = 1 - 3 * gray**2 / np.maximum(most, 1)  # squared sines of angles between colors
    turned = 1 - both**2 / np.maximum(light * most, 1)
    shade = np.exp(-turned / _TURNED**2) * np.clip((colorful - _DULL**2) / _DULL**2, 0, 1)
    return np.asarray(shade * ((both < most) & (both > _DARKEST * most)), np.float32)


def _features(image: np.ndarray) -> np.ndarray:
    import cv2

    return cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2LAB).astype(np.float32), (0, 0), 1.5)


def _in_noise(differences: Sequence[np.ndarray]) -> np.ndarray:
    """(H, W) float32 natural logarithm of differences (H, W, 3) in units of the image's noise, smoothed."""
    import cv2

    total = np.zeros(differences[0].shape[:2], np.float32)
    for difference in differences:
        flat = np.ascontiguousarray(difference.reshape(-1, 3)[::9].T)
        middle = np.median(flat, axis=1)  # another exposure
        variance = np.mean(np.minimum(np.abs(flat - middle[:, None]), 3.0) ** 2, axis=1)
        scaled = np.square(difference - middle)
        total += cv2.transform(scaled, 1 / (3 * np.maximum(variance, 0.09))[None])
    return 0.5 * np.log(np.maximum(cv2.GaussianBlur(total, (0, 0), 2.0) / len(differences), 0.05))


def _still(moved: np.ndarray) -> np.ndarray:
    """(H, W) bool: the large areas without motion."""
    import cv2

    still = cv2.morphologyEx((moved < _MOVED).astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(still, connectivity=4)
    areas = stats[1:, cv2.CC_STAT_AREA]
    large = np.zeros(count, bool)
    large[1:] = areas >= min(_CONNECTED * still.size, areas.max(initial=0))
    return large[labels]
