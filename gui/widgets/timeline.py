"""The timeline: plots above a track; a click or drag seeks."""

import time
from collections.abc import Callable, Sequence

import numpy as np
from open3d.visualization import gui

from v3studio.gui.models.playback.filmstrip import ASPECT, Filmstrip, draw_strip, has_pictures, slots
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.timeline import TimelineZoom
from v3studio.gui.models.playback.timeline_plots import Plot, TimelinePlots
from v3studio.gui.widgets.picture import ImagePanel, holds

HOVER_SECONDS = 4.0
"""Seconds that the values under the pointer stay at most: nothing tells that it has left the window, and without X not
even that it has left the timeline."""

STRIP = 3.5  # height of the strip of images, em


class TimelinePanel:
    """Shows the playhead, groups, quality and size per frame, and marks."""

    def __init__(self, player: PlayerPresenter, em: float, changed: Callable[[], None]) -> None:
        self.filmstrip = Filmstrip()  # draws the images above the plots
        self.filmstrip.changed.connect(changed)
        self.busy = False  # whether a stage runs on the open take or stream; no images are drawn meanwhile
        self._selecting: int | None = None  # where the drag began that selects a span
        self._player = player
        self._em = em
        self._changed = changed
        self._drawn: tuple[object, int | None, int | None] | None = None
        self.frame: int | None = None
        self._hover: int | None = None
        self._hover_until = 0.0
        self._covered = False
        self.explanation = ""  # what the plots show, the tooltip of their titles
        self._base: np.ndarray | None = None
        self._resume = False
        self._down = False
        self.plots: Sequence[Plot] = ()
        self.marks: tuple[int, ...] = ()
        self.zoom = TimelineZoom()  # the part of the frames that is shown; the wheel changes it, a right drag moves it
        self._panned: float | None = None
        self.path_keys: Sequence[int] = ()  # frames of the views of the camera path, which can be dragged
        # called with the index of such a view and its new frame
        self.moved_key: Callable[[int, int], None] = lambda key, frame: None
        self._dragged: tuple[int, int] | None = None
        self.picture = ImagePanel(self._on_mouse)

    @property
    def plots_view(self) -> TimelinePlots:
        """The current mapping of pixels to frames."""
        transport = self._player.transport
        return TimelinePlots(
            *self.picture.size,
            self._em,
            transport.frame_count,
            transport.group_starts,
            self.zoom.within(transport.frame_count),
            self._kept,
            self._picture_size[1] if has_pictures(self._player) else 0,
            transport.span,
            transport.fps,
            transport.numbers,
        )

    @property
    def _picture_size(self) -> tuple[int, int]:
        """Width and height of an image of the strip, pixels."""
        height = round(STRIP * self._em)
        return max(round(ASPECT * height), 1), max(height, 1)

    @property
    def strip_height(self) -> float:
        """Height of the strip of images, pixels; 0 if there is none."""
        return self._picture_size[1] if has_pictures(self._player) else 0.0

    @property
    def _kept(self) -> range | None:
        """The frames that the trim of the open take keeps; None for all."""
        trim = self._player.opened.trim if self._player.opened is not None else None
        return None if trim is None else self._player.transport.numbers.within(trim.first, trim.last)

    def fit(self) -> None:
        self.zoom = TimelineZoom()

    def update(self) -> bool:
        """Redraw what has changed; return whether anything did."""
        transport = self._player.transport
        frame = self._player.frame if self._player.opened is not None else None
        if frame is not None and frame != self.frame:
            self.zoom = self.zoom.following(frame, transport.frame_count)
        view, size = self.plots_view, self._picture_size
        frames = [slot.frame for slot in slots(view.timeline, size[0])] if has_pictures(self._player) else []
        pictures = self.filmstrip.pictures(self._player, frames, size, self.busy)
        drawn = tuple((shown, id(picture)) for shown, picture in pictures.items())
        below = (drawn, view, id(self.plots), self.marks, self._keys)
        if time.monotonic() > self._hover_until:
            self._hover = None
        hover = self._hover if frame is not None else None
        if (below, frame, hover) == self._drawn:
            return False
        if self._base is None or self._drawn is None or self._drawn[0] != below:
            strip = draw_strip(view.timeline, size, pictures) if pictures else None
            self._base = view.base(self.plots, strip)
        self._drawn = (below, frame, hover)
        self.frame = frame
        self.picture.show(view.with_head(self._base, frame, self.plots, self.marks, self._keys, hover))
        return True

    def look(self, pointer: tuple[int, int] | None, covered: bool) -> None:
        """Hide the values under the pointer if it has left. Call before `update`. `covered`: by a dialog or a list."""
        self._covered = covered
        if covered or (pointer is not None and not holds(self.picture.widget, *pointer)):
            self._hover = None

    @property
    def _keys(self) -> tuple[int, ...]:
        """Frames of the views, as dragged."""
        frames = list(self.path_keys)
        if self._dragged is not None and self._dragged[0] < len(frames):
            frames[self._dragged[0]] = self._dragged[1]
        return tuple(frames)

    def _on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        kind = gui.MouseEvent.Type
        view = self.plots_view
        frames, width = self._player.transport.frame_count, view.timeline.width
        if event.type == kind.WHEEL and self._covered:
            return True  # the list that lies over it scrolls
        if event.type == kind.WHEEL:
            share = min(max((x - view.left) / width, 0.0), 1.0)
            self.zoom = self.zoom.within(frames).zoomed(event.wheel_dy, share, frames)
            self._changed()
            return True
        if event.type == kind.DRAG and event.is_button_down(gui.MouseButton.RIGHT):
            if self._panned is not None and view.zoom.shown is not None:
                self.zoom = self.zoom.moved((self._panned - x) * view.zoom.shown / width, frames)
            self._panned = x
            self._changed()
            return True
        self._panned = None
        if event.type in (kind.MOVE, kind.DRAG):
            # the toolkit's tooltip appears at the pointer: over the titles only, where it covers no plot
            self.picture.widget.tooltip = self.explanation if x < view.left else ""
            self._hover = view.frame_at(x) if x >= view.left else None
            self._hover_until = time.monotonic() + HOVER_SECONDS
            self._changed()
        if self._player.opened is None or event.type not in (kind.BUTTON_DOWN, kind.DRAG, kind.BUTTON_UP):
            return False
        transport = self._player.transport
        if self._select(event, view, x, y):
            self._changed()
            return True
        if event.type == kind.BUTTON_UP:
            if self._dragged is not None:
                dragged, self._dragged = self._dragged, None
                self.moved_key(*dragged)
            if self._resume:
                transport.play()
            self._resume = self._down = False
        else:
            if event.type == kind.BUTTON_DOWN:
                self._down = True
                self._resume = transport.playing
                transport.pause()
                key = view.key_at(x, y, self._keys)
                self._dragged = None if key is None else (key, self._keys[key])
            if self._down and self._dragged is not None:
                self._dragged = (self._dragged[0], view.frame_at(x))
            if self._down:
                transport.seek(view.frame_at(x))
        self._changed()
        return True

    def _select(self, event: gui.MouseEvent, view: TimelinePlots, x: float, y: float) -> bool:
        """Select a span by a drag over the images, or anywhere with Shift; a click there clears it and seeks."""
        kind, transport = gui.MouseEvent.Type, self._player.transport
        if event.type == kind.BUTTON_DOWN:
            self._selecting = None  # the release of the last drag can be lost, to a dialog for example
        if event.type == kind.BUTTON_DOWN and event.is_button_down(gui.MouseButton.LEFT):
            shift = event.is_modifier_down(gui.KeyModifier.SHIFT)
            if x >= view.left and (shift or view.in_strip(y)):
                self._selecting = view.frame_at(x)
                transport.clear_span()
        if self._selecting is None:
            return False
        if event.type == kind.DRAG and view.frame_at(x) != self._selecting:
            transport.select_span(self._selecting, view.frame_at(x))
        if event.type == kind.BUTTON_UP:
            transport.seek(transport.span[0] if transport.span is not None else self._selecting)
            self._selecting = None
        return True
