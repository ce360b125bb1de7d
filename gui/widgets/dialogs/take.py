"""The dialog for a new take: footage, settings, folder, and a summary of the footage."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from open3d.visualization import gui

from gui.drawing.canvas import text_width, wrapped
from gui.models.take.new_take import Found, NewTake
from gui.widgets.dialogs.base import Dialogs, filled
from gui.widgets.dialogs.folder import ask_path
from gui.widgets.dialogs.form import Form, refusal
from gui.widgets.picture import lowered

FOUND_LINES, FOUND_WIDE = 8, 46
"""Lines of the summary, and its width in em."""

RATE_GIVEN = "Frames per second of the footage, as its files or the settings say"
RATE_TYPED = "Frames per second of the footage: its files do not say"


def ask_new_take(dialogs: Dialogs, new: NewTake, create: Callable[[NewTake], None], error: str = "") -> None:
    """Show the dialog.

    Args:
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
            typed = getattr(new, attribute).strip() or new.footage.strip()
            start = Path(typed) if typed else dialogs.usual_folder()
            ask_path(dialogs, title, start, wanted, done, again, (".yaml", ".yml") if wanted == "file" else ())

        return browse

    form = Form(dialogs, new)
    now = new.found() if new.footage or new.settings else Found("Choose the footage folder.")
    found = dialogs.label(_found(now.words, em, dialogs.room))
    rate = gui.TextEdit()
    refused = refusal(dialogs, error)
    refused.visible = error != ""
    fields: dict[str, gui.TextEdit] = {}

    def show_rate(now: Found) -> None:
        """The rate of the footage, or a field for it."""
        rate.enabled = now.fps is None
        if now.fps is not None:
            new.fps = ""
        rate.text_value = new.fps if now.fps is None else f"{now.fps:g}"
        rate.placeholder_text = "30, if nothing is typed" if new.footage or new.settings else ""
        rate.tooltip = RATE_GIVEN if now.fps is not None else RATE_TYPED

    def look_again(_text: str) -> None:
        now = new.found()
        refused.visible = False  # it was about what was typed before
        found.text = _found(now.words, em, dialogs.room)
        show_rate(now)
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
        form.browsed(attribute, label, edit, attribute, choose(attribute, title, wanted))
    rate.set_on_text_changed(lambda text: setattr(new, "fps", text))
    rate.set_on_value_changed(look_again)
    show_rate(now)
    fields["fps"] = rate
    form.beside(
        "fps", "Frame rate", rate, lowered(dialogs.label("fps"), room=text_width("Browse", round(em)) + 0.84 * em)
    )
    parts: list[gui.Widget] = [form.grid, found, refused]
    answers = [("create", "Create take", lambda: create(new)), ("close", "Cancel", dialogs.close)]
    dialogs.show("new take", "New take from footage", parts, answers, 110)
    dialogs.widgets |= form.widgets
    dialogs.focus(fields["footage"])


def _found(text: str, em: float, room: float) -> str:
    """The text in as many lines, and as wide, as the dialog has room for: it must not change its size while one types.

    Args:
        text: one or more lines.
        room: most width, pixels.
    """
    size, wide = round(em), min(FOUND_WIDE * em, room)
    lines = [line for part in text.splitlines() for line in wrapped(part, size, wide)][:FOUND_LINES]
    blank = " " * int(wide / text_width(" " * 100, size) * 100)
    return "\n".join([*filled(lines, FOUND_LINES), blank])
