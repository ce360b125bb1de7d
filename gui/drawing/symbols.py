"""Symbols of buttons, drawn at the size at which they are shown: the toolkit's font lacks them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gui.drawing.palette import RGB

Corners = Sequence[tuple[float, float]]

FINER = 8
"""Symbols are drawn as much larger and then averaged, for even edges."""

CORNER = 3.0
"""Radius of the corners of the toolkit's buttons, pixels, at every scale; their border is one pixel wide."""


def _bar(left: float, right: float) -> Corners:
    return ((left, 0.0), (right, 0.0), (right, 1.0), (left, 1.0))


_TO_LEFT: Corners = ((1.0, 0.0), (1.0, 1.0), (0.0, 0.5))
_TO_RIGHT: Corners = ((0.0, 0.0), (0.0, 1.0), (1.0, 0.5))


def _moved(corners: Corners, left: float, width: float) -> Corners:
    return [(left + width * x, y) for x, y in corners]


SYMBOLS: Mapping[str, Sequence[Corners]] = {
    "start": (_bar(0.0, 0.18), _moved(_TO_LEFT, 0.22, 0.78)),
    "back": (_moved(_TO_LEFT, 0.0, 0.72), _bar(0.82, 1.0)),
    "play": (_moved(_TO_RIGHT, 0.1, 0.9),),
    "pause": (_bar(0.08, 0.38), _bar(0.62, 0.92)),
    "forward": (_bar(0.0, 0.18), _moved(_TO_RIGHT, 0.28, 0.72)),
    "end": (_moved(_TO_RIGHT, 0.0, 0.78), _bar(0.82, 1.0)),
}
"""Polygons in the unit square, x to the right and y down, by name."""


def symbol(name: str, size: tuple[int, int], color: RGB, ground: RGB) -> np.ndarray:
    """(height, width, 3) uint8: a symbol in the middle of a button.

    Args:
        name: key of `SYMBOLS`.
        size: (width, height) of the button, pixels.
        color: of the symbol.
        ground: of the button.
    """
    import cv2

    width, height = size
    side = max(round(0.46 * height), 1)  # whole pixels, so that upright edges are sharp
    left, top = (width - side) // 2, (height - side) // 2
    cover = np.zeros((height * FINER, width * FINER), np.uint8)
    for corners in SYMBOLS[name]:
        # upright edges on whole pixels
        points = np.array([(left + round(side * x), top + side * y) for x, y in corners]) * FINER
        if len(corners) == 4:  # a bar; fillPoly would draw its right and lower edges a little outside
            (low_x, low_y), (high_x, high_y) = points.min(axis=0).astype(int), points.max(axis=0).astype(int)
            cover[low_y:high_y, low_x:high_x] = 255
        else:
            cv2.fillPoly(cover, [np.round(points).astype(np.int32)], 255)
    share = cv2.resize(cover, (width, height), interpolation=cv2.INTER_AREA)[..., None].astype(np.float32) / 255
    mixed = np.array(ground) + (np.array(color, np.float32) - np.array(ground)) * share
    return np.round(mixed).astype(np.uint8)


def framed(pixels: np.ndarray, border: RGB, outside: RGB) -> np.ndarray:
    """A copy of a button's image with the border and the round corners of the toolkit's buttons.

    Args:
        pixels: (height, width, 3) uint8.
        border: its color.
        outside: color behind the corners.
    """
    height, width = pixels.shape[:2]
    radius, thick = min(CORNER, height / 2), 1.0
    y, x = np.mgrid[:height, :width].astype(np.float32)
    # distance to the rounded rectangle's edge, negative inside
    across = np.abs(x - (width - 1) / 2) - (width / 2 - radius)
    down = np.abs(y - (height - 1) / 2) - (height / 2 - radius)
    away = np.hypot(np.maximum(across, 0), np.maximum(down, 0)) + np.minimum(np.maximum(across, down), 0) - radius
    within, filled = (np.clip(0.5 - distance, 0, 1)[..., None] for distance in (away, away + thick))
    inner = np.array(border) + (pixels - np.array(border, np.float32)) * filled
    return np.round(np.array(outside) + (inner - np.array(outside)) * within).astype(np.uint8)
