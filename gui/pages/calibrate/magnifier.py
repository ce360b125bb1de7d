"""Magnifier: zoom and pan of an image within a rectangle."""

import numpy as np

from gui.drawing.canvas import Canvas
from gui.models.playback.image_zoom import ImageZoom


class Magnifier:
    """The part of an image that is on screen, its rectangle there in pixels, and its magnification."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.width, self.height = size
        self.view = ImageZoom()
        self.rect = (0.0, 0.0, 1.0, 1.0)

    @property
    def _room(self) -> tuple[int, int]:
        return round(self.rect[2]), round(self.rect[3])

    def shown(self, x: float, y: float) -> tuple[float, float]:
        """Screen position of an image pixel."""
        scale, (left, top) = self.view.scale(self, *self._room), self.view.offset(self, *self._room)
        return self.rect[0] + left + scale * x, self.rect[1] + top + scale * y

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Image pixel at a screen position."""
        scale, (left, top) = self.view.scale(self, *self._room), self.view.offset(self, *self._room)
        return (x - self.rect[0] - left) / scale, (y - self.rect[1] - top) / scale

    def holds(self, x: float, y: float) -> bool:
        """Whether a pixel is in the rectangle."""
        left, top, width, height = self.rect
        return left <= x < left + width and top <= y < top + height

    def pan(self, dx: float, dy: float) -> None:
        self.view = self.view.moved(dx, dy, self, *self._room)

    def zoom(self, notches: float, x: float, y: float) -> None:
        """Zoom by notches of the wheel; the image point at screen position (x, y) stays fixed."""
        before = self.pixel(x, y)
        self.view = self.view.zoomed(notches)
        if self.view != ImageZoom():
            after = self.shown(*before)
            self.pan(x - after[0], y - after[1])

    def draw(self, canvas: Canvas, image: np.ndarray) -> None:
        """Draw the visible part into the rectangle."""
        canvas.image(self.rect[0], self.rect[1], self.view.whole(image, self, *self._room))
