"""The row of buttons above the viewport, which choose the picture or the tool of the selected stage."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial

from open3d.visualization import gui

from gui.panels.flow import Flow
from gui.panels.hints import Hints
from gui.panels.picture import color
from gui.presenters.drawing.icons import icon
from gui.presenters.drawing.palette import ACCENT_DARK, GROUND, RAISED

Choice = tuple[str, str, str]
"""Key, label, tooltip. An empty key is a gap."""

NAMED = frozenset(("truth", "trained", "decoded", "other", "scene", "edit", "done", "remove", "remove here"))
"""Buttons that keep their words, and lose their icons, where there is no room for both of all."""

PADDING, ICON_PADDING = 0.4, 0.3
"""Beside words, and beside an icon alone, em."""


class ModesPanel:
    """One set of buttons per stage, with icons; pressed ones are highlighted. Where the words of all would need a
    second line, buttons show their icons alone, and their hints begin with the words.

    Args:
        sets: choices by stage.
        em: font size, pixels.
        chosen: called with stage and key.
        hints: what the buttons do.
    """

    def __init__(
        self, sets: Mapping[str, Sequence[Choice]], em: float, chosen: Callable[[str, str], None], hints: Hints
    ) -> None:
        self._sets, self._hints, self._line = sets, hints, 1.5 * em
        self.rows: dict[str, Flow] = {}
        self.buttons: dict[tuple[str, str], gui.Button] = {}
        self._on: dict[tuple[str, str], bool] = {}
        self._short: dict[str, bool] = {}
        for stage, choices in sets.items():
            row = self.rows[stage] = Flow(0.25 * em, self._line)
            before = 0.0
            for key, _, _ in choices:
                if not key:
                    before = 0.5 * em
                    continue
                button = self.buttons[stage, key] = gui.Button("")
                button.vertical_padding_em = 0.05
                button.background_color = color(RAISED)
                button.set_on_clicked(partial(chosen, stage, key))
                row.add(button, before)
                before = 0.0
                self._on[stage, key] = False
            row.widget.background_color = color(GROUND)
            row.widget.visible = False
            self._write(stage, short=False)

    def _write(self, stage: str, short: bool) -> None:
        """Give the buttons of a stage icons and words, or icons alone (`short`)."""
        if self._short.get(stage) == short:
            return
        self._short[stage] = short
        for key, label, tooltip in self._sets[stage]:
            if not key:
                continue
            # the button that leaves the scene has the key of the one that opens it
            button, mark = self.buttons[stage, key], icon("done" if label == "Done" else key)
            alone = short and bool(mark) and key not in NAMED
            button.text = mark if alone else label if short else f"{mark} {label}".strip()
            button.horizontal_padding_em = ICON_PADDING if alone else PADDING
            self._hints.give(button, f"{label}: {tooltip}" if alone else tooltip, self.rows[stage].widget)

    def place(self, stage: str, x: float, y: float, width: float, context: gui.LayoutContext) -> float:
        """Set the position and width in window pixels; return the height of the stage's row."""
        for name, row in self.rows.items():
            self._write(name, short=False)
            if row.height(width, context) > 1.5 * self._line:
                self._write(name, short=True)
            row.place(x, y, width, context)
        return self.rows[stage].height(width, context)

    def update(self, stage: str, on: set[str], idle: Collection[str] = ()) -> tuple[bool, bool]:
        """Show the stage's row with these keys pressed, and `idle` ones disabled; return whether anything changed, and
        whether it is another row, which needs a layout."""
        changed = other = False
        for name, row in self.rows.items():
            if row.widget.visible != (name == stage):
                row.widget.visible = name == stage
                changed = other = True
        for (name, key), button in self.buttons.items():
            if name == stage and button.enabled != (key not in idle):
                button.enabled = key not in idle
                changed = True
            if name == stage and self._on[name, key] != (key in on):
                self._on[name, key] = key in on
                button.background_color = color(ACCENT_DARK if key in on else RAISED)
                changed = True
        return changed, other
