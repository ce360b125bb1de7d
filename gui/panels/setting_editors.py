"""Fields for settings: a checkbox, a list of choices, or text, with a slider or a button that chooses a path."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from open3d.visualization import gui

from gui.panels.picture import color
from gui.presenters.drawing.palette import RAISED
from gui.presenters.run.setting_words import FILES, FOLDERS
from gui.presenters.run.settings import SettingField

REST = 0.4
"""Seconds after which a slider that does not move has come to rest."""

SetValue = Callable[[SettingField, str], None]


@dataclass
class Editor:
    """Widgets of a setting.

    Attributes:
        widget: has the value.
        put: shows a value.
        slider, browse: further widgets, if there are any.
        commit: takes the value of a slider.
    """

    widget: gui.Widget
    put: Callable[[str], None]
    slider: gui.Slider | None = None
    browse: gui.Button | None = None
    commit: Callable[[], None] = lambda: None
    shown: str = ""
    moved: float | None = field(default=None)

    @property
    def parts(self) -> list[gui.Widget]:
        """All widgets, from left to right."""
        return [one for one in (self.slider, self.widget, self.browse) if one is not None]

    def show(self, text: str) -> None:
        """Show a value."""
        self.shown, self.moved = text, None
        self.put(text)

    def tick(self, now: float) -> None:
        """Take the value of a slider that has come to rest."""
        if self.moved is not None and now - self.moved > REST:
            self.moved = None
            self.commit()


def make_editor(setting: SettingField, em: float, set_value: SetValue, pick: Callable[[SettingField], None]) -> Editor:
    """The widgets of a setting.

    Args:
        setting: the setting.
        em: font size, pixels.
        set_value: called with the setting and the new text.
        pick: called when its path is to be chosen in a dialog.
    """
    if setting.kind == "switch":
        switch = gui.Checkbox("")
        switch.set_on_checked(lambda on: set_value(setting, "true" if on else "false"))
        return Editor(switch, lambda text: setattr(switch, "checked", text == "true"))
    if setting.kind == "choice":
        box = gui.Combobox()
        for choice in setting.choices:
            box.add_item(choice)
        box.set_on_selection_changed(lambda text, _: set_value(setting, text))
        return Editor(box, lambda text: setattr(box, "selected_text", text))
    edit = gui.TextEdit()
    edit.placeholder_text = setting.empty
    editor = Editor(edit, lambda text: setattr(edit, "text_value", text))

    def typed(text: str) -> None:
        if text != editor.shown:
            set_value(setting, text)

    edit.set_on_value_changed(typed)
    if setting.limits is not None:
        _add_slider(editor, edit, setting, set_value)
    if setting.name in FOLDERS | FILES:
        editor.browse = gui.Button("...")
        editor.browse.tooltip = "Choose it in a dialog"
        editor.browse.vertical_padding_em = 0.0
        editor.browse.horizontal_padding_em = 0.25
        editor.browse.background_color = color(RAISED)
        editor.browse.set_on_clicked(lambda: pick(setting))
    return editor


def _add_slider(editor: Editor, edit: gui.TextEdit, setting: SettingField, set_value: SetValue) -> None:
    assert setting.limits is not None
    slider = gui.Slider(gui.Slider.INT if setting.whole else gui.Slider.DOUBLE)
    slider.set_limits(*setting.limits)
    slider.background_color = color(RAISED)
    editor.slider = slider
    text_only = editor.put

    def text() -> str:
        return str(slider.int_value) if setting.whole else f"{slider.double_value:.2f}"

    def put(value: str) -> None:
        text_only(value)
        number = float(value)
        if setting.whole:
            slider.int_value = int(number)
        else:
            slider.double_value = number

    def slid(_: float) -> None:
        if float(text()) == float(editor.shown):  # set by `put`
            return
        edit.text_value = text()
        editor.moved = time.monotonic()

    def commit() -> None:
        if text() != editor.shown:
            set_value(setting, text())

    slider.set_on_value_changed(slid)
    editor.put, editor.commit = put, commit
