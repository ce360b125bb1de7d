"""NumPy images in Open3D's image widget."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import open3d as o3d
from open3d.visualization import gui

from gui.presenters.drawing.palette import GROUND, RGB

_marks = itertools.count(1)


def as_image(pixels: np.ndarray) -> o3d.geometry.Image:
    """An Open3D image of (H, W, 3) uint8 RGB. With four channels, the widget would blend with what is below it."""
    return o3d.geometry.Image(np.ascontiguousarray(pixels))


def color(value: RGB) -> gui.Color:
    """Convert a color for widgets."""
    return gui.Color(value[0] / 255, value[1] / 255, value[2] / 255)


def plain_label(text_color: RGB, ground: RGB) -> gui.Label:
    """An empty label with an opaque background."""
    label = gui.Label("")
    label.text_color, label.background_color = color(text_color), color(ground)
    return label


class PictureWidget:
    """An image widget that shows pictures pixel for pixel and forwards mouse events.

    Open3D lets images with equal content share a texture, so that updating one would change the other; therefore each
    starts with a unique placeholder.

    Args:
        on_mouse: receives events with the position in the widget (x, y, pixels) and returns whether it handled them.
    """

    def __init__(self, on_mouse: Callable[[gui.MouseEvent, float, float], bool] | None = None) -> None:
        self.widget = gui.ImageWidget()
        self._on_mouse = on_mouse
        self._shape: tuple[int, ...] = ()
        mark = next(_marks)
        placeholder = np.full((16, 16, 3), GROUND, np.uint8)
        placeholder.reshape(-1)[mark % placeholder.size] += 1
        self.show(placeholder)
        if on_mouse is not None:
            self.widget.set_on_mouse(self._mouse)

    def show(self, pixels: np.ndarray) -> None:
        """Show an image, stretched to the widget if their sizes differ."""
        if pixels.shape == self._shape:
            self.widget.update_image(as_image(pixels))
            return
        self._shape = pixels.shape  # another size needs a new texture
        ui_image = gui.UIImage(as_image(pixels))
        ui_image.scaling = gui.UIImage.Scaling.ANY
        self.widget.ui_image = ui_image

    def place(self, x: float, y: float, width: float, height: float) -> None:
        """Set the widget's rectangle in window pixels."""
        self.widget.frame = gui.Rect(int(x), int(y), max(int(width), 1), max(int(height), 1))

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the widget in pixels."""
        return max(int(self.widget.frame.width), 1), max(int(self.widget.frame.height), 1)

    def _mouse(self, event: gui.MouseEvent) -> gui.Widget.EventCallbackResult:
        assert self._on_mouse is not None
        taken = self._on_mouse(event, event.x - self.widget.frame.x, event.y - self.widget.frame.y)
        result = gui.Widget.EventCallbackResult
        return result.CONSUMED if taken else result.IGNORED
