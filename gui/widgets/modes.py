"""The row of buttons above the viewport, which choose the image or the tool of the selected stage."""

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial

import numpy as np
from open3d.visualization import gui

from v3studio.gui.drawing.palette import ACCENT, ACCENT_DARK, GROUND, RAISED
from v3studio.gui.widgets.flow import Flow
from v3studio.gui.widgets.hints import Hints
from v3studio.gui.widgets.picture import ImagePanel, color, holds, make_button, put

Choice = tuple[str, str, str]  # Key, label, tooltip. An empty key is a gap

BAR = 0.2
"""Height of the bar at the bottom of a pressed button under the pointer, em: the toolkit draws all gray there."""


class ModesPanel:
    """One set of buttons per stage; pressed ones are highlighted. `chosen`: called with stage and key."""

    def __init__(
        self, sets: Mapping[str, Sequence[Choice]], em: float, chosen: Callable[[str, str], None], hints: Hints
    ) -> None:
        self.rows: dict[str, Flow] = {}
        self.buttons: dict[tuple[str, str], gui.Button] = {}
        self._on: dict[tuple[str, str], bool] = {}
        self._bars: dict[str, ImagePanel] = {}
        self._bar_height = max(round(BAR * em), 2)
        for stage, choices in sets.items():
            row = self.rows[stage] = Flow(0.25 * em, 1.5 * em)
            before = 0.0
            for key, label, tooltip in choices:
                if not key:
                    before = 0.5 * em
                    continue
                action = partial(chosen, stage, key)
                button = self.buttons[stage, key] = make_button(label, action, pad=0.4, pad_y=0.05)
                hints.give(button, tooltip, row.widget)
                row.add(button, before)
                before = 0.0
                self._on[stage, key] = False
            bar = self._bars[stage] = ImagePanel()
            bar.show(np.full((1, 1, 3), ACCENT, np.uint8))
            bar.widget.visible = False
            row.widget.add_child(bar.widget)  # after the buttons, so that it is drawn over them
            row.widget.background_color = color(GROUND)
            row.widget.visible = False

    def place(self, stage: str, x: float, y: float, width: float, context: gui.LayoutContext) -> float:
        """Set the position and width in window pixels; return the height of the stage's row."""
        for row in self.rows.values():
            row.place(x, y, width, context)
        return self.rows[stage].height(width, context)

    def update(
        self, stage: str, on: set[str], idle: Collection[str] = (), pointer: tuple[int, int] | None = None
    ) -> tuple[bool, bool]:
        """Show the stage's row with these keys pressed, and `idle` ones disabled; return whether anything changed, and
        whether it is another row, which needs a layout. `pointer` is its position in the window, pixels, if known."""
        other = False
        for name, row in self.rows.items():
            other |= put(row.widget, visible=name == stage)
        changed, under = other, None
        for (name, key), button in self.buttons.items():
            if name != stage:
                continue
            changed |= put(button, enabled=key not in idle)
            if self._on[name, key] != (key in on):
                self._on[name, key] = key in on
                button.background_color = color(ACCENT_DARK if key in on else RAISED)
                changed = True
            if key in on and pointer is not None and holds(button, *pointer):
                under = button
        return changed | self._underline(stage, under), other

    def _underline(self, stage: str, button: gui.Button | None) -> bool:
        """Draw a bar at the bottom of a button, or none; returns whether that is a change."""
        bar = self._bars[stage]
        if button is not None:
            frame, high = button.frame, self._bar_height
            bar.place(frame.x, frame.y + frame.height - high, frame.width, high)
        return put(bar.widget, visible=button is not None)
