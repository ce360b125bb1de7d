"""The dialog for a new take: footage, settings, folder, and a summary of the footage."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from open3d.visualization import gui

from gui.panels.dialogs import Dialogs, broken
from gui.panels.folder_dialog import ask_path
from gui.panels.picture import color
from gui.presenters.drawing.palette import BAD
from gui.presenters.run.new_take import NewTake

FOUND_LINES = 8


def ask_new_take(dialogs: Dialogs, new: NewTake, create: Callable[[NewTake], None], error: str = "") -> None:
    """Show the dialog.

    Args:
        dialogs: shows it.
        new: the choices so far; modified while the dialog is open.
        create: called by "Create take"; the dialog stays open.
        error: why creating it failed.
    """
    dialogs.widgets = {}
    em = dialogs.em

    def choose(attribute: str, title: str, wanted: str) -> Callable[[], None]:
        def done(path: str) -> None:
            setattr(new, attribute, path)
            again()

        def again() -> None:
            ask_new_take(dialogs, new, create)

        def browse() -> None:
            start = Path(getattr(new, attribute).strip() or new.footage.strip() or ".")
            ask_path(dialogs, title, start, wanted, done, again, (".yaml", ".yml") if wanted == "file" else ())

        return browse

    grid = gui.VGrid(3, 0.5 * em)
    words = new.found() if new.footage or new.settings else "Choose the footage folder."
    found = dialogs.label(_found(words))
    fields: dict[str, gui.TextEdit] = {}

    def look_again(_text: str) -> None:
        found.text = _found(new.found())
        if not new.take:
            fields["take"].placeholder_text = new.proposed_take() or "a new folder"
        dialogs.laid_out()

    for attribute, label, title, wanted in (
        ("footage", "Footage", "Footage folder", "folder"),
        ("settings", "Settings (optional)", "Settings file (YAML)", "file"),
        ("take", "Take", "Take folder", "folder"),
    ):
        edit = fields[attribute] = gui.TextEdit()
        if attribute == "take" and not new.take:
            edit.placeholder_text = new.proposed_take() or "a new folder"
        edit.text_value = getattr(new, attribute)
        edit.set_on_text_changed(lambda text, attribute=attribute: setattr(new, attribute, text))
        edit.set_on_value_changed(look_again)
        grid.add_child(dialogs.label(label))
        grid.add_child(edit)
        browse = dialogs.button(f"browse_{attribute}", "Browse", choose(attribute, title, wanted))
        browse.vertical_padding_em = 0
        grid.add_child(browse)
    dialogs.widgets |= fields
    parts: list[gui.Widget] = [grid, found]
    if error:
        wrong = dialogs.label(broken(error))
        wrong.text_color = color(BAD)
        parts.append(wrong)
    answers = [("create", "Create take", lambda: create(new)), ("close", "Cancel", dialogs.close)]
    dialogs.show("new take", "New take from footage", parts, answers, 110)


def _found(text: str) -> str:
    """Pad or cut text to the lines that the dialog has room for, since it does not grow."""
    lines = broken(text).splitlines()[:FOUND_LINES]
    return "\n".join([*lines, *[" "] * (FOUND_LINES - len(lines))])
