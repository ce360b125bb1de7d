"""A dialog with fields, mostly for numbers."""

from collections.abc import Callable, Sequence
from types import SimpleNamespace

from gui.widgets.dialogs.base import Dialogs
from gui.widgets.dialogs.form import Form

Field = tuple[str, str, str]  # key, label, text


def ask_numbers(
    dialogs: Dialogs,
    title: str,
    text: str,
    fields: Sequence[Field],
    save: Callable[[dict[str, str]], str],
    error: str = "",
) -> None:
    """Ask for the texts of fields. `save` gets them by key; it returns "", or why they are refused: then it stays."""
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

    form.show("numbers", title, [dialogs.label(text), form.grid], ("save", "Apply", done), 70, error, fields[0][0])
