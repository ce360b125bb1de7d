"""Despill: remove the screen's light from the performer's outline.

A pixel at the outline mixes performer and screen, I = a F + (1 - a) B, and light from the screen also tints the
performer. The mixture is solved for F with the mask and the screen color next to the performer; the tint is limited by
the usual rule that the screen's channel may not exceed the larger of the other two. Both are applied only to the
outline, since clothes of the screen's hue would lose their color.
"""

import numpy as np

_LEAST_COVER = 0.1  # lower limit of alpha when solving for F; below it, noise dominates


def key_channels(color: np.ndarray) -> tuple[list[int], list[int]]:
    """The bright channels (0 red, 1 green, 2 blue) of a screen's (3,) RGB color: one for green, blue and red screens,
    two for yellow, cyan and magenta ones; and the other channels."""
    order = np.argsort(-np.asarray(color, np.float64), kind="stable")
    high, middle, low = (float(color[index]) for index in order)
    count = 1 if high - middle >= middle - low else 2
    return [int(index) for index in order[:count]], [int(index) for index in order[count:]]


def despill(image: np.ndarray, mask: np.ndarray, behind: np.ndarray, color: np.ndarray) -> np.ndarray:
    """Remove a screen's light, of RGB color (3,), from the performer's outline in an image (H, W, 3) uint8 RGB, by a
    mask (H, W) uint8, 255 = performer, and the screen `behind` them, (H, W, 3) uint8 RGB. Pixels farther from the
    outline than 1% of the performer's size (at least 3 pixels) are unchanged."""
    import cv2

    result = image.copy()
    across, down = cv2.boundingRect((mask > 127).astype(np.uint8))[2:]
    if not across:
        return result
    reach = max(3, round(0.01 * max(across, down)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    outline = np.nonzero((cv2.dilate(mask, disc) > 2) & (cv2.erode(mask, disc) < 253))
    cover = mask[outline].astype(np.float32)[:, None] / 255
    colors = (image[outline] - (1 - cover) * behind[outline]) / np.maximum(cover, _LEAST_COVER)
    colors = np.where(cover > 0.02, np.clip(colors, 0, 255), image[outline])
    bright, others = key_channels(color)
    surplus = np.maximum(colors[:, bright].min(axis=1) - colors[:, others].max(axis=1), 0)
    colors[:, bright] -= surplus[:, None]
    result[outline] = np.rint(colors).astype(np.uint8)
    return result
