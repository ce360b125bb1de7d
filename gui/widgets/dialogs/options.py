"""Option dialogs: preferences, exports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from open3d.visualization import gui

from gui.drawing.canvas import text_width
from gui.drawing.palette import BAD
from gui.models.preferences import BACKGROUND_NAMES, PICTURE_SIZES, Preferences
from gui.models.take.exports import FORMATS, MOVIE_BACKGROUNDS, MOVIE_SIZES, MOVIES, ExportRequest
from gui.widgets.dialogs.base import Dialogs, broken
from gui.widgets.dialogs.folder import ask_path
from gui.widgets.picture import color, lowered
from studio.errors import StudioError

FIELD = 16
"""Least width of a field in em: three numbers with signs fit."""


def ask_preferences(dialogs: Dialogs, now: Preferences, save: Callable[[Preferences], None]) -> None:
    """Show the preferences: render resolution, background, autoplay."""
    dialogs.widgets = {}
    chosen = replace(now, recent=list(now.recent))
    form = Form(dialogs, chosen)
    form.choice("picture_size", "Render resolution", list(PICTURE_SIZES))
    form.choice("background", "Background", BACKGROUND_NAMES)
    play = gui.Checkbox("")
    play.checked = chosen.play_on_opening
    play.set_on_checked(lambda on: setattr(chosen, "play_on_opening", on))
    form.add("play", "Autoplay", play)

    def done() -> None:
        dialogs.close()
        save(chosen)

    answers = [("save", "Save", done), ("close", "Cancel", dialogs.close)]
    dialogs.show("preferences", "Preferences", [form.grid], answers, 60, done)
    dialogs.widgets |= form.widgets


def ask_export(
    dialogs: Dialogs,
    request: ExportRequest,
    sources: Sequence[str],
    start: Callable[[ExportRequest], None],
    error: str = "",
) -> None:
    """Ask for the format, the source, the options of a movie, and the output path.

    Args:
        dialogs: shows it.
        request: the defaults; modified while the dialog is open.
        sources: "decoded" and "trained" as available; empty for a bare stream.
        start: called by "Export". If it raises StudioError or OSError, the dialog says why and keeps what was typed.
        error: why the export was refused.
    """
    dialogs.widgets = {}
    form = Form(dialogs, request)
    target = gui.TextEdit()

    def changed() -> None:
        target.text_value = request.target
        form.widgets["seconds"].enabled = request.kind == "turntable"
        form.widgets["size"].enabled = form.widgets["background"].enabled = request.kind in MOVIES

    form.choice("format", "Format", [label for label, _ in FORMATS.values()], changed)
    if sources:
        form.choice("of", "Splats", sources, changed)
    form.line("seconds", "Seconds")
    form.choice("size", "Size", MOVIE_SIZES)
    form.choice("background", "Background", list(MOVIE_BACKGROUNDS))
    changed()

    def browse() -> None:
        def done(folder: str) -> None:
            request.move_to(Path(folder))
            again()

        def again() -> None:
            ask_export(dialogs, request, sources, start)

        ask_path(dialogs, "Output folder", Path(request.target).parent, "folder", done, again)

    def go() -> None:
        try:
            start(request)
        except (StudioError, OSError) as refused:
            ask_export(dialogs, request, sources, start, str(refused))
        else:
            dialogs.close()

    target.set_on_text_changed(request.set_target)
    form.output(target, browse)
    source = (
        "decoded: as played back from the stream (default, as in v3studio export).\ntrained: before baking."
        if sources
        else "Exports the splats decoded from the stream."
    )
    words = (source, "Seconds, size and background are for movies.", "Existing files are never overwritten.")
    parts: list[gui.Widget] = [form.grid, *map(dialogs.label, words)]
    if error:
        parts.append(refusal(dialogs, error))
    answers = [("save", "Export", go), ("close", "Cancel", dialogs.close)]
    dialogs.show("export", "Export", parts, answers, 90, go)
    dialogs.widgets |= {**form.widgets, "line": target}
    dialogs.focus(target)


def refusal(dialogs: Dialogs, error: str) -> gui.Label:
    """Why a dialog could not be confirmed."""
    label = dialogs.label(broken(error))
    label.text_color = color(BAD)
    return label


class Form:
    """Labeled fields, each bound to an attribute of an object; a field is at least `FIELD` wide."""

    def __init__(self, dialogs: Dialogs, target: Any) -> None:
        self._dialogs, self._target = dialogs, target
        self.grid = gui.VGrid(2, round(0.6 * dialogs.em))
        self.widgets: dict[str, gui.Widget] = {}
        self._labels = 0

    def add(self, key: str, label: str, widget: gui.Widget) -> None:
        """A widget with its label; `key` names it among the dialog's widgets."""
        em = self._dialogs.em
        wide = text_width(label, round(em))
        words = label.replace(" ", "\u00a0")  # the grid would break it at spaces
        self.grid.add_child(lowered(self._dialogs.label(words), room=wide + 1.2 * em))
        self.grid.add_child(widget)
        self.widgets[key] = widget
        # a grid gives fields what its labels leave, and a dialog is as wide as its title by itself
        self._labels = max(self._labels, wide)
        self.grid.preferred_width = round(self._labels + (FIELD + 2) * em)

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

    def output(self, target: gui.TextEdit, browse: Callable[[], None]) -> None:
        """The field of the output path, with a button beside it, as the last one."""
        self.browsed("output", "Output", target, "target", browse)

    def browsed(self, key: str, label: str, field: gui.TextEdit, of: str, browse: Callable[[], None]) -> None:
        """A field for a path, with a button `browse_{of}` beside it."""
        button = self._dialogs.button(f"browse_{of}", "Browse", browse)
        button.vertical_padding_em = 0  # no higher than the field: the grid lays columns out by themselves
        self.beside(key, label, field, button)

    def beside(self, key: str, label: str, field: gui.TextEdit, widget: gui.Widget) -> None:
        """A field with another widget beside it."""
        row = gui.Horiz(round(0.4 * self._dialogs.em))
        row.add_child(field)
        row.add_child(widget)
        self.add(key, label, row)

    def line(self, attribute: str, label: str) -> None:
        """A line of text."""
        edit = gui.TextEdit()
        edit.text_value = getattr(self._target, attribute)
        edit.set_on_text_changed(lambda text: setattr(self._target, attribute, text))
        self.add(attribute, label, edit)
