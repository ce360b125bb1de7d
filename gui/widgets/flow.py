"""Flow: a row of widgets that wraps in a narrow window."""

from collections.abc import Sequence

import numpy as np
from open3d.visualization import gui


class Flow:
    """A row that wraps: Open3D's rows clip what does not fit. Hidden widgets take no room."""

    def __init__(self, gap: float, line: float) -> None:
        self.widget = gui.Widget()
        self._gap, self._line = gap, line
        self._items: list[tuple[gui.Widget, float, bool]] = []

    def add(self, widget: gui.Widget, before: float = 0.0, right: bool = False) -> None:
        """Append a widget, `before` extra pixels after the previous one: it begins a group, see `flow_lines`. `right`:
        right-align it and all later ones if there is room."""
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
                down = _down(widget, self._line, context)
                widget.frame = gui.Rect(int(x + left + shift), int(top + down), int(wide), int(self._line - down))

    def _lines(self, width: float, context: gui.LayoutContext) -> list[list[tuple[gui.Widget, float, float, bool]]]:
        """Each line's widgets with their left end, width, and whether they are right-aligned."""
        # hidden ones count, so that the others keep their places
        at_right = np.logical_or.accumulate([right for _, _, right in self._items])
        right = [bool(is_right) for is_right, item in zip(at_right, self._items, strict=True) if item[0].visible]
        shown = [item for item in self._items if item[0].visible]
        free = gui.Widget.Constraints()
        wides = [min(widget.calc_preferred_size(context, free).width, width) for widget, _, _ in shown]
        lines = flow_lines(wides, [before for _, before, _ in shown], width, self._gap)
        return [[(shown[at][0], left, wides[at], right[at]) for at, left in line] for line in lines]


def _down(widget: gui.Widget, line: float, context: gui.LayoutContext) -> int:
    """Pixels that a widget is lower than its line. The toolkit draws boxes at the top of their frame, as high as their
    text needs, which is less than a button of the line on a dense screen."""
    if not isinstance(widget, (gui.Checkbox, gui.Combobox)):
        return 0
    high = widget.calc_preferred_size(context, gui.Widget.Constraints()).height
    return max(round((line - high) / 2), 0)


def flow_lines(
    wides: Sequence[float], befores: Sequence[float], width: float, gap: float
) -> list[list[tuple[int, float]]]:
    """Index and left end of the items in each line; at least one line. Extra room before an item begins a group, which
    is not divided if a line can hold it."""
    lines: list[list[tuple[int, float]]] = [[]]
    x = 0.0
    for number, (wide, before) in enumerate(zip(wides, befores, strict=True)):
        left = x + (before if lines[-1] else 0.0)
        group = wide
        if before:
            for next_wide, next_before in zip(wides[number + 1 :], befores[number + 1 :], strict=True):
                if next_before:
                    break
                group += gap + next_wide
        if lines[-1] and left + (group if group <= width else wide) > width:
            lines.append([])
            left = 0.0
        lines[-1].append((number, left))
        x = left + wide + gap
    return lines
