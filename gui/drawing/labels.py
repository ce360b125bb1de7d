"""Places names beside what they name, where they cover least of it and not each other."""

from collections.abc import Sequence

import cv2
import numpy as np

from v3studio.gui.drawing.canvas import Canvas, line_height, text_width
from v3studio.gui.drawing.palette import GROUND, RGB, TEXT

GAP = 3  # pixels between a name and what it names


def draw_labels(
    canvas: Canvas, names: Sequence[str], shapes: Sequence[np.ndarray], size: int, colors: Sequence[RGB] = ()
) -> None:
    """Draw names on dark ground, each below, above, to the right or to the left of its shape, (N, 2) pixels whose
    convex hull counts, wherever it covers least of all shapes. Earlier ones choose first; names that would cover
    others are left out."""
    width, height, high = canvas.width, canvas.height, line_height(size)
    covered = np.zeros((height, width), np.uint8)
    for shape in shapes:
        hull = cv2.convexHull(np.clip(shape, -4 * max(width, height), 4 * max(width, height)).astype(np.int32))
        cv2.fillConvexPoly(covered, hull, 1)
    sums = cv2.integral(covered)
    taken = np.zeros_like(covered, bool)
    for number, (name, shape) in enumerate(zip(names, shapes, strict=True)):
        wide = text_width(name, size) + 6
        (left, top), (right, bottom) = shape.min(axis=0), shape.max(axis=0)
        middle, center = (left + right) / 2, (top + bottom) / 2
        places = (
            (middle - wide / 2, bottom + GAP), (middle - wide / 2, top - high - GAP),
            (right + GAP, center - high / 2), (left - wide - GAP, center - high / 2),
        )  # fmt: skip
        inside = [
            (round(x), round(y)) for x, y in places if 0 <= round(x) <= width - wide and 0 <= round(y) <= height - high
        ]
        free = [(x, y) for x, y in inside if not taken[y : y + high, x : x + wide].any()]
        if not free:
            continue
        x, y = min(
            free,
            key=lambda at: (
                int(sums[at[1] + high, at[0] + wide])
                - int(sums[at[1], at[0] + wide])
                - int(sums[at[1] + high, at[0]])
                + int(sums[at[1], at[0]])
            ),
        )
        taken[y : y + high, x : x + wide] = True
        below = canvas.pixels[y : y + high, x : x + wide].astype(np.float32)
        canvas.pixels[y : y + high, x : x + wide] = (0.3 * below + 0.7 * np.array(GROUND)).astype(np.uint8)
        canvas.text(x + 3, y + (high - 1.2 * size) / 2, name, size, colors[number] if colors else TEXT)
