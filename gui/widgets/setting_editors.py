"""Fields for settings: a checkbox, a list of choices, or text, with buttons that step a number or choose a path."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from open3d.visualization import gui

from v3studio.gui.models.take.setting_words import FILES, FOLDERS
from v3studio.gui.models.take.settings import FieldKind, SettingField
from v3studio.gui.widgets.picture import make_button

SetValue = Callable[[SettingField, str], None]


@dataclass
class Editor:
    """Widgets of a setting. `buttons`: "less" and "more", if it is a number with close limits, and "browse", from left
    to right. No slider: the toolkit's prints the number once more, and covers it with its handle. `grows`: it takes all
    the room that there is."""

    widget: gui.Widget
    put: Callable[[str], None]
    buttons: dict[str, gui.Button] = field(default_factory=dict)
    grows: bool = False
    shown: str = ""

    def show(self, text: str) -> None:
        """Show a value."""
        self.shown = text
        self.put(text)


def make_editor(setting: SettingField, set_value: SetValue, pick: Callable[[SettingField], None]) -> Editor:
    """The widgets of a setting. `pick`: called when its path is to be chosen in a dialog."""
    if setting.kind == FieldKind.SWITCH:
        switch = gui.Checkbox("")
        switch.set_on_checked(lambda on: set_value(setting, "true" if on else "false"))
        return Editor(switch, lambda text: setattr(switch, "checked", text == "true"))
    if setting.kind == FieldKind.CHOICE:
        box, items = gui.Combobox(), list(setting.choices)
        for choice in items:
            box.add_item(choice)
        box.set_on_selection_changed(lambda text, _: set_value(setting, text))

        def select(text: str) -> None:
            if text not in items:  # such as a source of masks of the user's own
                items.append(text)
                box.add_item(text)
            box.selected_text = text

        return Editor(box, select)
    edit = gui.TextEdit()
    edit.placeholder_text = setting.empty
    editor = Editor(edit, lambda text: setattr(edit, "text_value", text), grows=True)

    def typed(text: str) -> None:
        if text != editor.shown:
            set_value(setting, text)

    def step(count: int) -> None:
        text = setting.stepped(edit.text_value, count)
        if text not in (None, editor.shown):
            set_value(setting, text)

    edit.set_on_value_changed(typed)
    if setting.limits is not None:
        low, high = setting.limits
        editor.buttons["less"] = small_button("-", f"Lower; {low:g} at least", partial(step, -1))
        editor.buttons["more"] = small_button("+", f"Higher; {high:g} at most", partial(step, 1))
    if setting.name in FOLDERS | FILES:
        editor.buttons["browse"] = small_button("...", "Choose it in a dialog", lambda: pick(setting))
    return editor


def small_button(text: str, tooltip: str, *actions: Callable[[], object]) -> gui.Button:
    """A button as high as the fields."""
    button = make_button(text, *actions, pad=0.25 if len(text) > 1 else 0.4, pad_y=0.0)
    button.tooltip = tooltip
    return button
