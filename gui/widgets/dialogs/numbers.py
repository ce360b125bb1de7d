"""A dialog with numbers in fields."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace

from open3d.visualization import gui

from gui.widgets.dialogs.base import Dialogs
from gui.widgets.dialogs.options import Form, refusal

Field = tuple[str, str, str]
"""Key, label, text."""


def ask_numbers(
    dialogs: Dialogs,
    title: str,
    text: str,
    fields: Sequence[Field],
    save: Callable[[dict[str, str]], str],
    error: str = "",
) -> None:
    """Ask for the texts of fields.

    Args:
        dialogs: shows it.
        title: heading.
        text: what the numbers mean.
        fields: with their present texts.
        save: gets what was typed, by key; returns "", or why it was refused: the dialog stays and says so.
        error: why it was refused before.
    """
    dialogs.widgets = {}
    typed = SimpleNamespace(**{key: value for key, _, value in fields})
    form = Form(dialogs, typed)
    for key, label, _ in fields:
        form.line(key, label)

    def done() -> None:
        found = {key: str(getattr(typed, key)) for key, _, _ in fields}
        refused = save(found)
        if refused:
            again = [(key, label, found[key]) for key, label, _ in fields]
            ask_numbers(dialogs, title, text, again, save, refused)
        else:
            dialogs.close()

    parts: list[gui.Widget] = [dialogs.label(text), form.grid]
    if error:
        parts.append(refusal(dialogs, error))
    answers = [("save", "Apply", done), ("close", "Cancel", dialogs.close)]
    dialogs.show("numbers", title, parts, answers, 70, done)
    dialogs.widgets |= form.widgets
    first = form.widgets[fields[0][0]]
    assert isinstance(first, gui.TextEdit)
    dialogs.focus(first)
