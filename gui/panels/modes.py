"""The row of buttons above the viewport, which choose the picture of the selected stage."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from open3d.visualization import gui

from gui.panels.flow import Flow
from gui.panels.picture import color
from gui.presenters.drawing.palette import ACCENT_DARK, GROUND, RAISED

Choice = tuple[str, str, str]
"""Key, label, tooltip. An empty key is a gap."""


class ModesPanel:
    """One set of buttons per stage; pressed ones are highlighted.

    Args:
        sets: choices by stage.
        em: font size, pixels.
        chosen: called with stage and key.
    """

    def __init__(self, sets: Mapping[str, Sequence[Choice]], em: float, chosen: Callable[[str, str], None]) -> None:
        self.rows: dict[str, Flow] = {}
        self.buttons: dict[tuple[str, str], gui.Button] = {}
        self._on: dict[tuple[str, str], bool] = {}
        for stage, choices in sets.items():
            row = Flow(0.35 * em, 1.5 * em)
            before = 0.0
            for key, label, tooltip in choices:
                if not key:
                    before = 0.8 * em
                    continue
                button = gui.Button(label)
                button.tooltip = tooltip
                button.vertical_padding_em = 0.05
                button.horizontal_padding_em = 0.7
                button.background_color = color(RAISED)
                button.set_on_clicked(partial(chosen, stage, key))
                row.add(button, before)
                before = 0.0
                self.buttons[stage, key] = button
                self._on[stage, key] = False
            row.widget.background_color = color(GROUND)
            row.widget.visible = False
            self.rows[stage] = row

    def place(self, stage: str, x: float, y: float, width: float, context: gui.LayoutContext) -> float:
        """Set the position and width in window pixels; return the height of the stage's row."""
        for row in self.rows.values():
            row.place(x, y, width, context)
        return self.rows[stage].height(width, context)

    def update(self, stage: str, on: set[str]) -> bool:
        """Show the stage's row with these keys pressed; return whether anything changed."""
        changed = False
        for name, row in self.rows.items():
            if row.widget.visible != (name == stage):
                row.widget.visible = name == stage
                changed = True
        for (name, key), button in self.buttons.items():
            if name == stage and self._on[name, key] != (key in on):
                self._on[name, key] = key in on
                button.background_color = color(ACCENT_DARK if key in on else RAISED)
                changed = True
        return changed
