"""The row of buttons above the viewport, which choose the image or the tool of the selected stage."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial

import numpy as np
from open3d.visualization import gui

from gui.drawing.icons import icon
from gui.drawing.palette import ACCENT, ACCENT_DARK, GROUND, RAISED
from gui.widgets.flow import Flow
from gui.widgets.hints import Hints
from gui.widgets.picture import ImagePanel, color, holds, put

Choice = tuple[str, str, str]
"""Key, label, tooltip. An empty key is a gap."""

NAMED = frozenset(("footage", "trained", "decoded", "other", "scene", "edit", "done"))
"""Buttons that keep their words, and lose their icons, where there is no room for both of all."""

UNLIKE = (
    frozenset(("remove",)),
    frozenset(("floaters", "numbers", "removed")),
    frozenset(("ground", "origin", "detail", "list")),
    frozenset(("in", "out", "up", "scale")),
    frozenset(("look", "crop", "lasso", "brush")),
)
"""Buttons that have words as well, instead of their icons, as far as there is room: first those that matter most and
whose icons say least."""

TIGHT = 0.5
"""What gaps are multiplied by where there is room for the first of these words only."""

PADDING, ICON_PADDING = 0.4, 0.3
"""Beside words, and beside an icon alone, em."""

BAR = 0.2
"""Height of the bar at the bottom of a pressed button under the pointer, em. The toolkit draws every button gray there,
with no color of its own."""

_LEVELS: tuple[tuple[frozenset[str] | None, float], ...] = (
    (None, 1.0),
    *((NAMED.union(*UNLIKE[:count]), 1.0) for count in range(len(UNLIKE), 1, -1)),
    *((NAMED.union(*UNLIKE[:count]), TIGHT) for count in range(2, -1, -1)),
)
"""Keys of the buttons with words, None for all, and the spacing; the first that fits into a line is taken."""


class ModesPanel:
    """One set of buttons per stage, with icons; pressed ones are highlighted. Where the words of all would need a
    second line, only so many have words that they fit into one; the others show their icons alone, and their hints
    begin with the words.

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
        self._words: dict[str, frozenset[str] | None] = {}
        self._bars: dict[str, ImagePanel] = {}
        self._bar_height = max(round(BAR * em), 2)
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
            bar = self._bars[stage] = ImagePanel()
            bar.show(np.full((1, 1, 3), ACCENT, np.uint8))
            bar.widget.visible = False
            row.widget.add_child(bar.widget)  # after the buttons, so that it is drawn over them
            row.widget.background_color = color(GROUND)
            row.widget.visible = False
            self._write(stage, None)

    def _write(self, stage: str, words: frozenset[str] | None) -> None:
        """Give the buttons of a stage icons and words (None), or only these words, and icons alone to the others."""
        if stage in self._words and self._words[stage] == words:
            return
        self._words[stage] = words
        for key, label, tooltip in self._sets[stage]:
            if not key:
                continue
            # the button that leaves the scene has the key of the one that opens it
            button, mark = self.buttons[stage, key], icon("done" if label == "Done" else key)
            alone = words is not None and bool(mark) and key not in words
            button.text = mark if alone else f"{mark} {label}".strip() if words is None else label
            button.horizontal_padding_em = ICON_PADDING if alone else PADDING
            self._hints.give(button, f"{label}: {tooltip}" if alone else tooltip, self.rows[stage].widget)

    def place(self, stage: str, x: float, y: float, width: float, context: gui.LayoutContext) -> float:
        """Set the position and width in window pixels; return the height of the stage's row."""
        for name, row in self.rows.items():
            for words, row.spacing in _LEVELS:
                self._write(name, words)
                if row.height(width, context) < 1.5 * self._line:
                    break
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
