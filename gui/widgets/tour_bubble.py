"""The text of a step of the tour, beside the control that it is about."""

from __future__ import annotations

from collections.abc import Callable

from open3d.visualization import gui

from gui.drawing.canvas import wrapped
from gui.drawing.palette import ACCENT, ACCENT_DARK, RAISED, TEXT
from gui.models.tour import STEPS, Tour
from gui.widgets.picture import color

WIDTH = 24.0
"""Em."""

HINTS = {"next": "Enter", "back": "Backspace", "skip": "Esc"}


class TourBubble:
    """See the module. A container over the view; it must not overlap other containers.

    Args:
        tour: which step is shown.
        em: font size, pixels.
        act: called with "next", "back" or "skip".

    Attributes:
        buttons: by key.
        words: what is shown; "" while nothing is.
        target: the control that it is about; None or the view itself: it lies at the view's lower edge.
    """

    def __init__(self, tour: Tour, em: float, act: Callable[[str], None]) -> None:
        self._tour, self._em, self._act = tour, em, act
        self.buttons: dict[str, gui.Button] = {}
        self.words = ""
        self.target: gui.Widget | None = None
        self._shown: object = None
        self._content = gui.WidgetProxy()
        self.widget = gui.Vert(0, gui.Margins(round(0.9 * em), round(0.7 * em), round(0.9 * em), round(0.8 * em)))
        self.widget.background_color = color(ACCENT_DARK)
        self.widget.add_child(self._content)
        self.widget.visible = False

    @property
    def shown(self) -> list[object]:
        """Number of the step, counted from 1, and its words; [] if nothing is shown."""
        number = self._tour.number
        return [number + 1, self.words] if self.words and number is not None else []

    def update(self, words: str, room: float) -> bool:
        """Show the step; returns whether anything changed, which needs a layout.

        Args:
            words: text of the step; "" to hide it.
            room: width of the view, pixels.
        """
        step = self._tour.step
        width = min(WIDTH * self._em, room - 3 * self._em)
        state = (self._tour.number, words, width) if step is not None and words else None
        if state == self._shown:
            return False
        self._shown, self.buttons, self.words = state, {}, words if state is not None else ""
        self.widget.visible = state is not None
        if state is not None and step is not None:
            self._content.set_widget(self._filled(step.title, words, width))
        return True

    def _filled(self, title: str, words: str, width: float) -> gui.Widget:
        em, number = self._em, self._tour.number or 0
        column = gui.Vert(round(0.45 * em))
        heading = gui.Label(f"{title}   ({number + 1} of {len(STEPS)})")
        heading.text_color = color(ACCENT)
        column.add_child(heading)
        label = gui.Label("\n".join(wrapped(words, round(em), width - 1.8 * em)))
        label.text_color = color(TEXT)
        column.add_child(label)
        row = gui.Horiz(round(0.5 * em))
        names = [("next", "Done" if self._tour.is_last else "Next")]
        if number:
            names.append(("back", "Back"))
        if not self._tour.is_last:
            names.append(("skip", "Skip"))
        for key, text in names:
            button = gui.Button(f"{text} ({HINTS[key]})")
            button.vertical_padding_em = 0.1
            button.horizontal_padding_em = 0.6
            button.background_color = color(RAISED)
            button.set_on_clicked(lambda key=key: self._act(key))
            row.add_child(button)
            self.buttons[key] = button
        column.add_child(row)
        return column

    def place(self, context: gui.LayoutContext, x: float, y: float, width: float, height: float) -> None:
        """Place it in the view, next to its target; the view's rectangle is given in window pixels."""
        if not self.widget.visible:
            return
        em = self._em
        wanted = self.widget.calc_preferred_size(context, gui.Widget.Constraints())
        wide, high = min(wanted.width, width), min(wanted.height, height)
        left, top = x + (width - wide) / 2, y + height - high - em  # the view itself: at its lower edge
        if self.target is not None:
            target = self.target.frame
            if (target.width, target.height) == (int(width), int(height)):
                target = gui.Rect(int(left), int(top), int(wide), int(high))
            left = min(max(target.x + (target.width - wide) / 2, x + em), x + width - wide - em)
            top = min(max(target.y + (target.height - high) / 2, y + em), y + height - high - em)
        self.widget.frame = gui.Rect(int(max(left, x)), int(max(top, y)), int(wide), int(high))
