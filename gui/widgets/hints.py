"""Hints on buttons, shown where there is room beside them: the toolkit's own tooltips cover their neighbors."""

import time
from collections.abc import Iterable

from open3d.visualization import gui

from v3studio.gui.drawing.canvas import Canvas, line_height, text_width, wrapped
from v3studio.gui.drawing.palette import LINE, TEXT
from v3studio.gui.widgets.picture import ImagePanel, holds

DELAY = 0.4  # seconds for which the pointer must rest on a button
WIDEST = 0.6  # widest hint over the view, as a part of its width; longer text wraps
LEAST_HIGH = 32  # pixels; the toolkit's ground of a widget is no lower, and would show below it
STEP = 8  # widths of hints are multiples of this, pixels, because the toolkit keeps a texture of each size
Box = tuple[int, int, int, int]  # left, top, width, height; pixels


class Hints:
    """Shows the hint of a button; the toolkit's tooltips do where the pointer cannot be followed (`follows`). An image,
    because the toolkit makes no label with a background less than 32 pixels high."""

    def __init__(self, follows: bool, em: float) -> None:
        self._follows, self._em = follows, em
        self._texts: dict[gui.Widget, tuple[gui.Widget, str]] = {}  # row and text
        self._over: gui.Widget | None = None
        self._clicked: gui.Widget | None = None  # no hint of it until the pointer has left it
        self._since = 0.0
        self.text = ""  # what it says; "" if there is none
        # whether a list is open, as far as is known: the toolkit does not report it, and a hint closes it
        self.listing = False
        self.picture = ImagePanel()  # the hint; its widget is to be added to the window
        self.picture.widget.visible = False

    def give(self, widget: gui.Widget, text: str, row: gui.Widget) -> None:
        """Set the hint of a widget in a row, which is hidden with it."""
        if self._follows:
            self._texts[widget] = (row, text)
        else:
            widget.tooltip = text

    def press(self, x: int, y: int, lists: Iterable[gui.Widget]) -> None:
        """The left button is pressed at a window pixel. `lists`: the widgets that open a list when they are clicked."""
        self._clicked = self._at(x, y)
        self.listing = not self.listing and any(widget.visible and holds(widget, x, y) for widget in lists)

    def update(self, pointer: tuple[int, int] | None, hidden: bool) -> bool:
        """Show the hint of the button under a resting pointer, window pixels; returns whether a layout is needed."""
        over = self._at(*pointer) if pointer is not None else None
        if over is not self._clicked:
            self._clicked = None
        if hidden or self._clicked is not None:
            over = None
        if over is not self._over:
            self._over, self._since = over, time.monotonic()
        text = self._texts[over][1] if over is not None and time.monotonic() >= self._since + DELAY else ""
        if self.text == text:
            return False
        self.text, self.picture.widget.visible = text, bool(text)
        return True

    def hide(self) -> None:
        """Show none until the pointer has rested again."""
        self.text, self._over, self.picture.widget.visible = "", None, False

    def _at(self, x: int, y: int) -> gui.Widget | None:
        shown = (widget for widget, (row, text) in self._texts.items() if text and widget.visible and row.visible)
        return next((widget for widget in shown if holds(widget, x, y)), None)

    def place(self, view: Box) -> None:
        """Place the hint beside the buttons of its row if there is room, which covers nothing; else over the view
        (pixels), as near to its widget as that allows."""
        if self._over is None or not self.text:
            return
        em, frame = self._em, self._over.frame
        size, pad, gap = round(0.88 * em), round(0.4 * em), round(0.5 * em)
        high = max(round(1.4 * em), LEAST_HIGH)
        wide = _stepped(text_width(self.text, size) + 2 * pad)
        rooms = [(left, right) for left, right in self._gaps(self._over, gap) if right - left >= wide]
        if rooms:
            left, right = min(rooms, key=lambda room: max(room[0] - frame.x, frame.x - room[1], 0))
            x = min(max(frame.x, left), right - wide)
            self._draw([self.text], x, frame.y + (frame.height - high) // 2, wide, high)
            return
        most = int(WIDEST * view[2])
        lines = wrapped(self.text, size, most - 2 * pad)
        wide = _stepped(max(text_width(line, size) for line in lines) + 2 * pad)
        high += (len(lines) - 1) * line_height(size)
        x, y = (
            round(min(max(at, start + gap), start + room - length - gap))
            for at, start, room, length in ((frame.x, view[0], view[2], wide), (frame.y, view[1], view[3], high))
        )
        self._draw(lines, x, y, wide, high)

    def _gaps(self, over: gui.Widget, gap: int) -> list[tuple[int, int]]:
        """Columns of the line of a widget that none takes in its row, from left to right."""
        line, row = over.frame, self._texts[over][0].frame
        left, gaps = row.x, []
        beside = [widget for widget, (row, _) in self._texts.items() if row is self._texts[over][0]]
        frames = [widget.frame for widget in beside if widget.visible]
        for frame in sorted(frames, key=lambda frame: frame.x):
            if frame.y < line.y + line.height and line.y < frame.y + frame.height:
                gaps.append((left, frame.x - gap))
                left = max(left, frame.x + frame.width + gap)
        return [*gaps, (left, row.x + row.width)]

    def _draw(self, lines: list[str], x: int, y: int, wide: int, high: int) -> None:
        em = self._em
        size, step = round(0.88 * em), line_height(round(0.88 * em))
        canvas = Canvas(wide, high, LINE)
        text_top = (high - len(lines) * step) / 2 + (step - 1.2 * size) / 2
        canvas.lines(round(0.4 * em), text_top, lines, size, TEXT)
        self.picture.show(canvas.pixels)
        self.picture.place(x, y, wide, high)


def _stepped(width: float) -> int:
    return -int(-width // STEP) * STEP
