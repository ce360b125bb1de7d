"""Magnifier: zoom and pan of an image within a rectangle."""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np

from gui.drawing.canvas import Canvas
from gui.drawing.palette import GROUND

_MOST = 24.0
_NOTCH = 1.25


class Magnifier:
    """The part of an image that is on screen, and its magnification.

    Args:
        size: width and height of the image.

    Attributes:
        scale: magnification relative to the whole image fitted into the rectangle, at least 1.
        center: (x, y) in the image at the center of the rectangle.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        self.scale = 1.0
        self.center = (size[0] / 2, size[1] / 2)
        self.rect = (0.0, 0.0, 1.0, 1.0)

    @property
    def key(self) -> Hashable:
        """Hashable state, for change detection."""
        return self.scale, self.center

    def place(self, rect: tuple[float, float, float, float]) -> None:
        """Set the rectangle: x, y, width, height in screen pixels."""
        self.rect = rect

    @property
    def factor(self) -> float:
        """Screen pixels per image pixel."""
        return self.scale * min(self.rect[2] / self.size[0], self.rect[3] / self.size[1])

    def shown(self, x: float, y: float) -> tuple[float, float]:
        """Screen position of an image pixel."""
        left, top, width, height = self.rect
        factor = self.factor
        return left + width / 2 + (x - self.center[0]) * factor, top + height / 2 + (y - self.center[1]) * factor

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Image pixel at a screen position."""
        left, top, width, height = self.rect
        factor = self.factor
        return self.center[0] + (x - left - width / 2) / factor, self.center[1] + (y - top - height / 2) / factor

    def holds(self, x: float, y: float) -> bool:
        """Whether a pixel is in the rectangle."""
        left, top, width, height = self.rect
        return left <= x < left + width and top <= y < top + height

    def pan(self, dx: float, dy: float) -> None:
        """Pan by screen pixels."""
        factor = self.factor
        self._look_at(self.center[0] - dx / factor, self.center[1] - dy / factor)

    def zoom(self, notches: float, x: float, y: float) -> None:
        """Zoom by notches of the wheel; the image point at screen position (x, y) stays fixed."""
        before = self.pixel(x, y)
        self.scale = min(max(self.scale * _NOTCH**notches, 1.0), _MOST)
        after = self.pixel(x, y)
        self._look_at(self.center[0] + before[0] - after[0], self.center[1] + before[1] - after[1])

    def _look_at(self, x: float, y: float) -> None:
        """Set the center, clamped to the image."""
        half = [self.rect[axis + 2] / self.factor / 2 for axis in (0, 1)]
        places = []
        for axis, value in enumerate((x, y)):
            low, high = half[axis], self.size[axis] - half[axis]
            places.append(self.size[axis] / 2 if low >= high else min(max(value, low), high))
        self.center = (places[0], places[1])

    def draw(self, canvas: Canvas, image: np.ndarray) -> None:
        """Draw the visible part into the rectangle."""
        import cv2

        left, top, width, height = (round(value) for value in self.rect)
        factor = self.factor
        first = self.pixel(left, top)
        part = image
        if factor < 1:  # average first when shrinking, then shift
            small = (max(round(image.shape[1] * factor), 1), max(round(image.shape[0] * factor), 1))
            part = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
        across, down = part.shape[1] / image.shape[1], part.shape[0] / image.shape[0]
        # OpenCV's origin is the center of the first pixel
        warp = np.array(
            [
                [factor / across, 0, 0.5 * factor / across - 0.5 - first[0] * factor],
                [0, factor / down, 0.5 * factor / down - 0.5 - first[1] * factor],
            ]
        )
        flags = cv2.INTER_CUBIC if factor > 1 else cv2.INTER_LINEAR
        canvas.image(left, top, cv2.warpAffine(part, warp, (width, height), flags=flags, borderValue=GROUND))
