"""Dialogs with labeled fields."""

from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from open3d.visualization import gui

from v3studio.gui.drawing.canvas import text_width
from v3studio.gui.drawing.palette import BAD
from v3studio.gui.widgets.dialogs.base import Answer, Dialogs, broken
from v3studio.gui.widgets.dialogs.folder import ask_path
from v3studio.gui.widgets.picture import lowered, make_label

FIELD, PATH = 16, 28  # least width of a field in em: three numbers with signs fit; of those of a form with a path


def refusal(error: str) -> gui.Label:
    """The reason why a dialog could not be confirmed."""
    return make_label(broken(error), BAD)


class Form:
    """Labeled fields, each bound to an attribute of an object. `gap`: between two fields, em."""

    def __init__(self, dialogs: Dialogs, target: Any, gap: float = 0.6) -> None:
        self._dialogs, self._target = dialogs, target
        self.grid = gui.VGrid(2, round(gap * dialogs.em))
        self.widgets: dict[str, gui.Widget] = {}
        self._labels, self._field = 0, FIELD

    def add(self, key: str, label: str, widget: gui.Widget) -> None:
        """A widget with its label; `key` names it among the dialog's widgets."""
        em = self._dialogs.em
        wide = text_width(label, round(em))
        words = label.replace(" ", "\u00a0")  # the grid would break it at spaces
        self.grid.add_child(lowered(self._dialogs.label(words), room=wide + 1.2 * em))
        self.grid.add_child(widget)
        self.widgets[key] = widget
        # a grid gives fields what its labels leave, and a dialog is as wide as its title alone
        self._labels = max(self._labels, wide)
        self.grid.preferred_width = round(self._labels + (self._field + 2) * em)

    def choice(
        self, attribute: str, label: str, names: Sequence[str], after: Callable[[], None] = lambda: None
    ) -> None:
        """One of `names`; `after` is called when another one was chosen."""
        box = gui.Combobox()
        for name in names:
            box.add_item(name)
        box.selected_text = getattr(self._target, attribute)

        def chosen(text: str, _number: int) -> None:
            setattr(self._target, attribute, text)
            after()

        box.set_on_selection_changed(chosen)
        self.add(attribute, label, box)

    def output(self, again: Callable[[], None]) -> None:
        """The field of the output path, and a button that asks for the folder; `again` then shows this dialog."""
        request = self._target
        field = gui.TextEdit()
        field.text_value = request.target
        field.set_on_text_changed(request.set_target)

        def done(folder: str) -> None:
            request.move_to(Path(folder))
            again()

        def browse() -> None:
            ask_path(self._dialogs, "Output folder", Path(request.target).parent, "folder", done, again)

        self._field = PATH
        self.browsed("line", "Output", field, "target", browse)

    def browsed(self, key: str, label: str, field: gui.TextEdit, of: str, browse: Callable[[], None]) -> None:
        """A field for a path, with a button `browse_{of}` beside it."""
        button = self._dialogs.button(f"browse_{of}", "Browse", browse)
        button.vertical_padding_em = 0  # no higher than the field: the grid lays columns out by themselves
        row = gui.Horiz(round(0.4 * self._dialogs.em))
        row.add_child(field)
        row.add_child(button)
        self.add(key, label, row)
        self.widgets[key] = field

    def switch(self, attribute: str, label: str) -> None:
        """A checkbox."""
        box = gui.Checkbox("")
        box.checked = getattr(self._target, attribute)
        box.set_on_checked(lambda on: setattr(self._target, attribute, on))
        self.add(attribute, label, box)

    def line(self, attribute: str, label: str) -> None:
        edit = gui.TextEdit()
        edit.text_value = getattr(self._target, attribute)
        edit.set_on_text_changed(lambda text: setattr(self._target, attribute, text))
        self.add(attribute, label, edit)

    def show(
        self, name: str, title: str, parts: Sequence[gui.Widget], confirm: Answer, width: float, error: str = "",
        first: str = "",
    ) -> None:  # fmt: skip
        """Show the dialog. `first`: key of the text field that has the keyboard focus; "" for none."""
        dialogs = self._dialogs
        shown = [*parts, *([refusal(error)] if error else [])]
        dialogs.show(name, title, shown, [confirm, ("close", "Cancel", dialogs.close)], width, confirm[2])
        dialogs.widgets |= self.widgets
        if first:
            dialogs.focus(self.widgets[first])


def ask_numbers(
    dialogs: Dialogs,
    title: str,
    text: str,
    fields: Sequence[tuple[str, str, str]],
    save: Callable[[dict[str, str]], str],
    error: str = "",
) -> None:
    """Ask for the texts of fields: key, label, text. `save` gets them by key; returns "", or why the dialog stays."""
    typed = SimpleNamespace(**{key: value for key, _, value in fields})
    form = Form(dialogs, typed)
    for key, label, _ in fields:
        form.line(key, label)

    def done() -> None:
        texts = {key: str(getattr(typed, key)) for key, _, _ in fields}
        refused = save(texts)
        if refused:
            again = [(key, label, texts[key]) for key, label, _ in fields]
            ask_numbers(dialogs, title, text, again, save, refused)
        else:
            dialogs.close()

    form.show("numbers", title, [dialogs.label(text), form.grid], ("save", "Apply", done), 70, error, fields[0][0])
