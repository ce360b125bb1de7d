"""The timeline's widget: click or drag to seek."""

from __future__ import annotations

from collections.abc import Callable

from open3d.visualization import gui

from gui.panels.picture import as_image, image_widget, plain
from gui.presenters.player import PlayerPresenter
from gui.presenters.timeline import BACKGROUND, Timeline


class TimelinePanel:
    """Shows which frame is due and where groups begin.

    Args:
        player: whose transport is shown and moved.
        changed: called after each seek.
    """

    def __init__(self, player: PlayerPresenter, changed: Callable[[], None]) -> None:
        self._player = player
        self._changed = changed
        self._size = (64, 16)
        self._drawn: tuple[object, ...] | None = None
        self._resume = False
        self.widget = image_widget(plain(*self._size, BACKGROUND, mark=2))
        self.widget.set_on_mouse(self._on_mouse)

    @property
    def timeline(self) -> Timeline:
        """Pixels and frames as they are now."""
        transport = self._player.transport
        return Timeline(*self._size, transport.frame_count, transport.group_starts)

    def place(self, x: float, y: float, width: float, height: float) -> None:
        """Take this rectangle of the window (pixels)."""
        self.widget.frame = gui.Rect(x, y, width, height)
        self._size = (max(int(width), 16), max(int(height), 8))

    def update(self) -> bool:
        """Draw again where something changed; returns whether it did."""
        transport = self._player.transport
        frame = transport.frame if self._player.source is not None else None
        state = (self._size, frame, transport.frame_count, transport.group_starts)
        if state == self._drawn:
            return False
        self._drawn = state
        self.widget.update_image(as_image(self.timeline.picture(frame)))
        return True

    def _on_mouse(self, event: gui.MouseEvent) -> gui.Widget.EventCallbackResult:
        kind = gui.MouseEvent.Type
        if self._player.source is None or event.type not in (kind.BUTTON_DOWN, kind.DRAG, kind.BUTTON_UP):
            return gui.Widget.EventCallbackResult.IGNORED
        transport = self._player.transport
        if event.type == kind.BUTTON_UP:
            if self._resume:
                transport.play()
            self._resume = False
        else:
            if event.type == kind.BUTTON_DOWN:
                self._resume = transport.playing
                transport.pause()
            transport.seek(self.timeline.frame_at(event.x - self.widget.frame.x))
        self._changed()
        return gui.Widget.EventCallbackResult.CONSUMED
