"""What buttons do, shown over the view beside them: the toolkit's own tooltips cover their neighbors."""

from __future__ import annotations

import time
from collections.abc import Callable

from open3d.visualization import gui

from gui.panels.picture import plain_label
from gui.presenters.drawing.palette import LINE, TEXT

DELAY = 0.4
"""Seconds for which the pointer must rest on a button."""


class Hints:
    """See the module. Where the pointer cannot be followed, these are tooltips of the toolkit.

    Args:
        follows: whether `update` will be told where the pointer is.
        now: a clock in seconds that never runs backwards.

    Attributes:
        label: the hint; to be added to the window.
    """

    def __init__(self, follows: bool, now: Callable[[], float] = time.monotonic) -> None:
        self._follows, self._now = follows, now
        self._texts: list[tuple[gui.Widget, gui.Widget, str]] = []
        self._over: gui.Widget | None = None
        self._since = 0.0
        self.label = plain_label(TEXT, LINE)
        self.label.visible = False

    def give(self, widget: gui.Widget, text: str, row: gui.Widget) -> None:
        """Set the hint of a widget in a row, which is hidden with it."""
        if not self._follows:
            widget.tooltip = text
            return
        self._texts = [one for one in self._texts if one[0] is not widget]
        self._texts.append((widget, row, text))

    def update(self, pointer: tuple[int, int] | None, hidden: bool) -> bool:
        """Show the hint of what the pointer rests on; returns whether anything changed, which needs a layout.

        Args:
            pointer: its position in the window, pixels; None if it is not known.
            hidden: whether a button is pressed, or something covers the panels.
        """
        found = None
        if pointer is not None and not hidden:
            found = next((one for one in self._texts if _shown_at(one, *pointer)), None)
        over = found[0] if found is not None else None
        if over is not self._over:
            self._over, self._since = over, self._now()
        text = f" {found[2]} " if found is not None and self._now() >= self._since + DELAY else ""
        if self.label.text == text:
            return False
        self.label.text, self.label.visible = text, bool(text)
        return True

    def place(self, context: gui.LayoutContext, em: float, view: tuple[int, int, int, int]) -> None:
        """Place the hint in the view (x, y, width, height; pixels), as near to its widget as that allows."""
        if self._over is None or not self.label.visible:
            return
        limits = gui.Widget.Constraints()
        limits.width = int(0.6 * view[2])
        wanted = self.label.calc_preferred_size(context, limits)
        one_line = wanted.width < limits.width
        wide, gap = min(wanted.width, limits.width), round(0.5 * em)
        high = round(1.4 * em) if one_line else wanted.height
        x, y = (
            round(min(max(at, start + gap), start + room - size - gap))
            for at, start, room, size in (
                (self._over.frame.x, view[0], view[2], wide), (self._over.frame.y, view[1], view[3], high),
            )
        )  # fmt: skip
        self.label.frame = gui.Rect(x, y, wide, high)


def _shown_at(one: tuple[gui.Widget, gui.Widget, str], x: int, y: int) -> bool:
    widget, row, text = one
    frame = widget.frame
    inside = frame.x <= x < frame.x + frame.width and frame.y <= y < frame.y + frame.height
    return inside and bool(text) and widget.visible and row.visible
