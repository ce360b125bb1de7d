"""Flow: a row of widgets that wraps in a narrow window."""

from __future__ import annotations

from open3d.visualization import gui


class Flow:
    """See the module. Open3D's rows clip what does not fit. Hidden widgets take no room.

    Args:
        gap: pixels between widgets, and between lines.
        line: height of a line in pixels.

    Attributes:
        widget: the widget to add to the window.
    """

    def __init__(self, gap: float, line: float) -> None:
        self.widget = gui.Widget()
        self._gap, self._line = gap, line
        self._items: list[tuple[gui.Widget, float, bool]] = []

    def add(self, widget: gui.Widget, before: float = 0.0, right: bool = False) -> None:
        """Append a widget.

        Args:
            widget: the widget.
            before: extra pixels between it and the previous one.
            right: right-align it and all later ones if there is room.
        """
        self.widget.add_child(widget)
        self._items.append((widget, before, right))

    def height(self, width: float, context: gui.LayoutContext) -> float:
        """Height in pixels at this width."""
        count = len(self._lines(width, context))
        return count * self._line + (count - 1) * self._gap

    def place(self, x: float, y: float, width: float, context: gui.LayoutContext) -> None:
        """Set the position and width in window pixels; the height is that of `height`."""
        lines = self._lines(width, context)
        # slightly higher than its lines, to avoid a scroll bar
        room = self.height(width, context) + 0.15 * self._line
        self.widget.frame = gui.Rect(int(x), int(y), int(width), int(room))
        for number, line in enumerate(lines):
            top = y + number * (self._line + self._gap)
            spare = width - (line[-1][1] + line[-1][2]) if line else 0.0
            for widget, left, wide, right in line:
                shift = spare if right and not number else 0.0
                widget.frame = gui.Rect(int(x + left + shift), int(top), int(wide), int(self._line))

    def _lines(self, width: float, context: gui.LayoutContext) -> list[list[tuple[gui.Widget, float, float, bool]]]:
        """Each line's widgets with their left end, width, and whether they are right-aligned."""
        lines: list[list[tuple[gui.Widget, float, float, bool]]] = [[]]
        x, right = 0.0, False
        for widget, before, at_right in self._items:
            if not widget.visible:
                continue
            right |= at_right
            wide = min(widget.calc_preferred_size(context, gui.Widget.Constraints()).width, width)
            left = x + (before if lines[-1] else 0.0)
            if lines[-1] and left + wide > width:
                lines.append([])
                left = 0.0
            lines[-1].append((widget, left, wide, right))
            x = left + wide + self._gap
        return lines
