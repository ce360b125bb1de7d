"""The settings of a stage under headings, with documentation as tooltips and a search field."""

from __future__ import annotations

import textwrap
from collections.abc import Callable

from open3d.visualization import gui

from gui.panels.picture import color
from gui.presenters.drawing.palette import ACCENT, DIM, PANEL
from gui.presenters.run.settings import SettingField, fields_of, matching
from pipelines.config import Config


class SettingsList:
    """See the module.

    Args:
        stage: key of `TITLES`.
        em: font size, pixels.
        set_value: called with the field and the new text.
        changed: called when the filter has changed; call `refilter` afterwards.
    """

    def __init__(
        self, stage: str, em: float, set_value: Callable[[SettingField, str], None], changed: Callable[[], None]
    ) -> None:
        self._em, self._set_value, self._changed = em, set_value, changed
        self._fields = fields_of(stage)
        self.editors: dict[str, tuple[SettingField, gui.Widget]] = {}
        self._shown: dict[str, str] = {}
        self._words: str | None = None
        self._typed = ""
        self.widget = gui.Widget()
        self.widget.background_color = color(PANEL)
        self.filter = gui.TextEdit()
        self.filter.placeholder_text = "search settings"
        self.filter.tooltip = "Show settings whose name, heading or documentation contains all of these words"
        self.filter.set_on_text_changed(self._type)
        self._scroll = gui.ScrollableVert(0, gui.Margins(0.6 * em, 0.2 * em, 1.2 * em, 0.4 * em))
        self._scroll.background_color = color(PANEL)
        self._content = gui.WidgetProxy()
        self._scroll.add_child(self._content)
        self.widget.add_child(self.filter)
        self.widget.add_child(self._scroll)
        self.refilter()

    def find(self, name: str) -> None:
        """Filter for one setting; call `refilter` afterwards."""
        self.filter.text_value = self._typed = name

    def _type(self, text: str) -> None:
        self._typed = text
        self._changed()

    def place(self, x: float, y: float, width: float, height: float) -> None:
        """Set the panel's rectangle in window pixels."""
        em = self._em
        left, above, top = int(x), int(y), int(1.9 * em)
        wide, high = int(width), int(y + height) - above  # whole pixels: a child one pixel too high adds a scroll bar
        self.widget.frame = gui.Rect(left, above, wide, high)
        self.filter.frame = gui.Rect(int(x + 0.6 * em), int(above + 0.2 * em), int(width - 1.2 * em), int(1.4 * em))
        self._scroll.frame = gui.Rect(left, above + top, wide, max(high - top, 1))

    def refilter(self) -> bool:
        """Apply the filter; return whether the list has changed, which requires `show` and a new layout. Deferred to
        the next tick, because the toolkit reports typing while it draws the window."""
        if self._words == self._typed:
            return False
        self._words = self._typed
        self.editors.clear()
        grid = gui.VGrid(2, 0.25 * self._em)
        heading = ""
        found = matching(self._fields, self._words)
        # headings share a column with the labels: a longer one would take the width from the fields
        width = max(16, *(len(field.label) for field in found)) if found else 16
        for field in found:
            if field.heading != heading:
                heading = field.heading
                lines = textwrap.wrap(heading, width, break_long_words=False)
                title = gui.Label("\n".join(lines))
                title.text_color = color(ACCENT)
                grid.add_child(title)
                grid.add_child(gui.Label("\n".join(" " for _ in lines)))  # as high: columns are laid out separately
            label = gui.Label(field.label)
            label.tooltip = _broken(field.documentation)
            label.text_color = color(DIM)
            grid.add_child(label)
            editor = self._editor(field)
            editor.tooltip = _broken(field.documentation)
            grid.add_child(editor)
            self.editors[field.name] = (field, editor)
        if not found:
            grid.add_child(gui.Label("No matching settings."))
        self._content.set_widget(grid)
        return True

    def _editor(self, field: SettingField) -> gui.Widget:
        set_value = self._set_value
        if field.kind == "switch":
            switch = gui.Checkbox("")
            switch.set_on_checked(lambda on: set_value(field, "true" if on else "false"))
            return switch
        if field.kind == "choice":
            box = gui.Combobox()
            for choice in field.choices:
                box.add_item(choice)
            box.set_on_selection_changed(lambda text, _: set_value(field, text))
            return box
        edit = gui.TextEdit()

        def typed(text: str) -> None:
            if text != self._shown.get(field.name):
                set_value(field, text)

        edit.set_on_value_changed(typed)
        return edit

    def show(self, config: Config) -> None:
        """Show the values of the settings."""
        for name, (field, editor) in self.editors.items():
            text = field.shown(config)
            self._shown[name] = text
            if field.kind == "switch":
                editor.checked = text == "true"
            elif field.kind == "choice":
                editor.selected_text = text
            else:
                editor.text_value = text


def _broken(text: str) -> str:
    """Wrap a tooltip; the toolkit shows it as one line otherwise."""
    return "\n".join(textwrap.wrap(text, 70))
