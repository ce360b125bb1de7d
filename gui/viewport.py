"""The viewport: the rasterizer's picture in an image widget, with mouse gestures.

Left drag turns, right or middle drag (or shift and left drag) moves, the wheel goes nearer. The picture is drawn by the
house's own rasterizer on a thread of its own (`gui.presenters.player`), so the window never waits for it.
"""

from __future__ import annotations

from collections.abc import Callable

from open3d.visualization import gui

from gui.panels.picture import as_image, image_widget, plain
from gui.presenters.player import Picture, PlayerPresenter

EMPTY = (28, 30, 33)
"""Colour where nothing is open, 8-bit sRGB."""

MAX_PIXELS = 960 * 540
"""Pictures have at most so many pixels and are stretched to the widget, which bounds the time to draw one."""


def picture_size(width: float, height: float) -> tuple[int, int]:
    """Size in pixels of the picture for a widget: its own, or smaller with the same aspect to stay in MAX_PIXELS."""
    shrink = min(1.0, (MAX_PIXELS / max(width * height, 1.0)) ** 0.5)
    return max(int(width * shrink), 16), max(int(height * shrink), 16)


class Viewport:
    """Shows the player's pictures and turns mouse gestures into camera moves.

    Args:
        player: whose pictures are shown.
        changed: called after each gesture.
    """

    def __init__(self, player: PlayerPresenter, changed: Callable[[], None]) -> None:
        self._player = player
        self._changed = changed
        self._last: tuple[int, int] | None = None
        self.widget = image_widget(plain(*player.size, EMPTY, mark=1))
        self.widget.set_on_mouse(self._on_mouse)

    def place(self, x: float, y: float, width: float, height: float) -> None:
        """Take this rectangle of the window (pixels)."""
        self.widget.frame = gui.Rect(x, y, width, height)
        self._player.resize(*picture_size(width, height))

    def show(self, picture: Picture) -> None:
        """Put a new picture up."""
        self.widget.update_image(as_image(picture.image))

    def _on_mouse(self, event: gui.MouseEvent) -> gui.Widget.EventCallbackResult:
        kind = gui.MouseEvent.Type
        if event.type == kind.BUTTON_DOWN:
            self._last = (event.x, event.y)
        elif event.type == kind.DRAG:
            self._drag(event)
        elif event.type == kind.BUTTON_UP:
            self._last = None
        elif event.type == kind.WHEEL:
            self._player.wheel(event.wheel_dy)
            self._changed()
        else:
            return gui.Widget.EventCallbackResult.IGNORED
        return gui.Widget.EventCallbackResult.CONSUMED

    def _drag(self, event: gui.MouseEvent) -> None:
        if self._last is None:
            self._last = (event.x, event.y)
        # Gestures are in widget pixels; the picture may have fewer.
        scale = self._player.size[1] / max(self.widget.frame.height, 1)
        dx, dy = event.x - self._last[0], event.y - self._last[1]
        self._last = (event.x, event.y)
        turn = event.is_button_down(gui.MouseButton.LEFT) and not event.is_modifier_down(gui.KeyModifier.SHIFT)
        if turn:
            self._player.drag_orbit(dx, dy)
        else:
            self._player.drag_pan(dx * scale, dy * scale)
        self._changed()
