"""The viewport: an image widget with mouse gestures.

Left drag orbits, right, middle or Shift + left drag pans, the wheel zooms; the line of a wipe is dragged. Images are
rendered on threads (`gui.models`), so the window never waits for them.
"""

from collections.abc import Callable

import numpy as np
from open3d.visualization import gui

from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.picture import ImagePanel

_STILL = 3.0  # pixels that the pointer may move during a click


class Viewport:
    """Shows images and turns mouse events into gestures of the views, at pixels of the image. `most_pixels`: maximum
    number of pixels of an image, which bounds the time to render it; it is stretched to the widget. `pictures`: number
    of images shown so far."""

    most_pixels: int

    def __init__(self, views: StageViews, changed: Callable[[], None]) -> None:
        self._views, self._changed = views, changed
        self._last: tuple[float, float] | None = None
        self._pulling = False
        self._clicking = self._right = False
        self.clicked_at = self._start = (0.0, 0.0)
        self.picture_size, self.pictures = (16, 16), 0
        self.picture = ImagePanel(self.on_mouse)

    @property
    def render_size(self) -> tuple[int, int]:
        """Size of images rendered from splats: that of the widget, or smaller to stay fast."""
        width, height = self.picture.size
        shrink = min(1.0, (self.most_pixels / max(width * height, 1.0)) ** 0.5)
        return max(int(width * shrink), 16), max(int(height * shrink), 16)

    def show(self, pixels: np.ndarray) -> None:
        self.picture_size, self.pictures = (pixels.shape[1], pixels.shape[0]), self.pictures + 1
        self.picture.show(pixels)

    def on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        """Handle a mouse event at a position in the widget, pixels; returns whether it was for the viewport."""
        kind, shown = gui.MouseEvent.Type, self._views.on_screen
        # Gestures are in widget pixels; the image may have fewer.
        scale = self.picture_size[0] / max(self.picture.size[0], 1)
        if event.type == kind.BUTTON_DOWN:
            self._last = self._start = (x, y)
            self._clicking = event.is_button_down(gui.MouseButton.LEFT)
            self._right = event.is_button_down(gui.MouseButton.RIGHT)
            self._pulling = self._clicking and shown.grabs(x * scale, y * scale)
        elif event.type == kind.DRAG and self._last is not None:
            moved = max(abs(x - self._start[0]), abs(y - self._start[1]))
            if (self._clicking or self._right) and moved <= _STILL:
                return True  # an unsteady click is not a drag
            self._clicking = self._right = False
            dx, dy = x - self._last[0], y - self._last[1]
            self._last = (x, y)
            if self._pulling:
                shown.pull(x * scale, y * scale)
            else:
                left = event.is_button_down(gui.MouseButton.LEFT)
                turn = left and not event.is_modifier_down(gui.KeyModifier.SHIFT)
                shown.drag(*((dx, dy) if turn else (dx * scale, dy * scale)), turn, self.picture_size[1])
            self._changed()
        elif event.type == kind.BUTTON_UP:
            self.clicked_at = (self.picture.widget.frame.x + x, self.picture.widget.frame.y + y)
            if self._right:
                self._views.context(x * scale, y * scale)
                self._changed()
            elif self._pulling:
                shown.release()
                self._changed()
            elif self._clicking:
                self._views.click(x * scale, y * scale)
                self._changed()
            self._last = None
            self._pulling = self._clicking = self._right = False
        elif event.type == kind.WHEEL:
            shown.wheel(x * scale, y * scale, event.wheel_dy)
            self._changed()
        else:
            return False
        return True
