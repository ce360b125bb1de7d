"""Dialogs: questions, a line to type, a new take, preferences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from open3d.visualization import gui

from gui.panels.picture import colour
from gui.presenters.new_take import NewTake
from gui.presenters.palette import ACCENT_DARK, BAD, DIM, RAISED
from gui.presenters.preferences import BACKGROUND_NAMES, PICTURE_SIZES, Preferences

Answer = tuple[str, str, Callable[[], None]]
"""Key, label, what to do."""


FOUND_LINES = 8


class Dialogs:
    """Shows one dialog at a time over a window.

    Attributes:
        widgets: of the open dialog, by key; empty where none is open.
        name: of the open dialog; "" where none is open.
    """

    def __init__(self, window: gui.Window) -> None:
        self._window = window
        self._em = window.theme.font_size
        self.widgets: dict[str, gui.Widget] = {}
        self.name = ""
        self._focus: tuple[int, gui.Widget] | None = None

    def close(self) -> None:
        """Close what is open."""
        self._focus = None
        if self.name:
            self._window.close_dialog()
        self.widgets, self.name = {}, ""

    def _show(
        self, name: str, title: str, parts: Sequence[gui.Widget], answers: Sequence[Answer], width: float
    ) -> None:
        made = self.widgets
        self.close()
        self.widgets = made
        em = self._em
        dialog = gui.Dialog(title)
        column = gui.Vert(0.6 * em, gui.Margins(em, em, em, em))
        heading = gui.Label(title + " " * max(int(width - len(title)), 0))  # the widest line gives the dialog its width
        column.add_child(heading)
        for part in parts:
            column.add_child(part)
        row = gui.Horiz(0.5 * em)
        row.add_stretch()
        for number, (key, label, action) in enumerate(answers):
            row.add_child(self._button(key, label, action, accent=number == 0))
        column.add_child(row)
        dialog.add_child(column)
        self.name = name
        self._window.show_dialog(dialog)

    def _button(self, key: str, label: str, action: Callable[[], None], accent: bool = False) -> gui.Button:
        button = gui.Button(label)
        button.vertical_padding_em = 0.2
        button.background_color = colour(ACCENT_DARK if accent else RAISED)
        button.set_on_clicked(action)
        self.widgets[key] = button
        return button

    def _label(self, text: str, dim: bool = True) -> gui.Label:
        label = gui.Label(text)
        if dim:
            label.text_color = colour(DIM)
        return label

    def tick(self) -> None:
        """Call at each drawn tick: gives a new dialog's field the keyboard."""
        if self._focus is None:
            return
        left, widget = self._focus
        self._focus = (left - 1, widget) if left else None
        if not left and self.name:
            self._window.set_focus_widget(widget)

    def message(self, title: str, text: str) -> None:
        """Something to read."""
        self.widgets = {}
        self._show("message", title, [self._label(text, dim=False)], [("close", "Close", self.close)], 60)

    def ask(self, title: str, text: str, answers: Sequence[Answer]) -> None:
        """A question with answers; each closes the dialog first."""
        self.widgets = {}
        closing = [(key, label, self._closing(action)) for key, label, action in answers]
        self._show("ask", title, [self._label(text, dim=False)], closing, 60)

    def line(
        self, name: str, title: str, text: str, value: str, answers: Sequence[tuple[str, str, Callable[[str], None]]]
    ) -> None:
        """A line to type; answers get what was typed."""
        self.widgets = {}
        edit = gui.TextEdit()
        edit.text_value = value
        typed = [value]

        def changed(now: str) -> None:
            typed[0] = now

        edit.set_on_text_changed(changed)

        def answer(action: Callable[[str], None]) -> Callable[[], None]:
            return self._closing(lambda: action(typed[0]))

        parts: list[gui.Widget] = [self._label(text), edit]
        buttons: list[Answer] = [(key, label, answer(action)) for key, label, action in answers]
        self._show(name, title, parts, buttons, 70)
        self.widgets["line"] = edit
        self._focus = (2, edit)  # once the dialog has been drawn; before that it is lost

    def choose(self, name: str, title: str, choices: Sequence[str], chosen: Callable[[str], None]) -> None:
        """One of a few lines."""
        self.widgets = {}
        parts: list[gui.Widget] = []
        for number, choice in enumerate(choices):
            parts.append(self._button(f"choice{number}", choice, self._closing(partial(chosen, choice))))
        if not choices:
            parts.append(self._label("There is nothing here yet."))
        self._show(name, title, parts, [("close", "Close", self.close)], 60)

    def _closing(self, action: Callable[[], None]) -> Callable[[], None]:
        def go() -> None:
            self.close()
            action()

        return go

    def folder(self, title: str, done: Callable[[str], None], cancelled: Callable[[], None] | None = None) -> None:
        """A folder: the one that the dialog has gone into, not one that is marked in its list."""
        self._file(gui.FileDialog.OPEN_DIR, f"{title} (go into it by a double click, then Open)", done, cancelled, ())

    def file(
        self,
        title: str,
        endings: Sequence[str],
        done: Callable[[str], None],
        cancelled: Callable[[], None] | None = None,
    ) -> None:
        """A file with one of these endings."""
        self._file(gui.FileDialog.OPEN, title, done, cancelled, endings)

    def _file(
        self,
        mode: int,
        title: str,
        done: Callable[[str], None],
        cancelled: Callable[[], None] | None,
        endings: Sequence[str],
    ) -> None:
        self.close()
        dialog = gui.FileDialog(mode, title, self._window.theme)
        for ending in endings:
            dialog.add_filter(ending, f"*{ending}")

        def chosen(path: str) -> None:
            self.close()
            done(path)

        def stopped() -> None:
            self.close()
            if cancelled is not None:
                cancelled()

        dialog.set_on_cancel(stopped)
        dialog.set_on_done(chosen)
        self.name = "file"
        self._window.show_dialog(dialog)

    def new_take(self, new: NewTake, create: Callable[[NewTake], None], error: str = "") -> None:
        """Footage, settings, the take's folder; what was found in the footage."""
        self.widgets = {}
        em = self._em

        def again() -> None:
            self.new_take(new, create)

        def choose(attribute: str, title: str, file: bool) -> Callable[[], None]:
            def done(path: str) -> None:
                setattr(new, attribute, path)
                again()

            def browse() -> None:
                if file:
                    self.file(title, (".yaml", ".yml"), done, again)
                else:
                    self.folder(title, done, again)

            return browse

        grid = gui.VGrid(3, 0.5 * em)
        words = new.found() if new.footage or new.settings else "Choose the folder of the footage."
        found = self._label(_found(words))
        for attribute, label, title, file in (
            ("footage", "Footage", "Folder of the footage", False),
            ("settings", "Settings (optional)", "Settings of a run, YAML", True),
            ("take", "Take", "Folder for the take", False),
        ):
            edit = gui.TextEdit()
            if attribute == "take" and not new.take:
                edit.placeholder_text = new.proposed_take() or "a new folder"
            edit.text_value = getattr(new, attribute)
            edit.set_on_text_changed(lambda text, attribute=attribute: setattr(new, attribute, text))
            edit.set_on_value_changed(lambda text: self._look_again(new, found))
            grid.add_child(self._label(label))
            grid.add_child(edit)
            browse = self._button(f"browse_{attribute}", "Browse", choose(attribute, title, file))
            browse.vertical_padding_em = 0
            grid.add_child(browse)
            self.widgets[attribute] = edit
        parts: list[gui.Widget] = [grid, found]
        if error:
            wrong = self._label(_broken(error))
            wrong.text_color = colour(BAD)
            parts.append(wrong)

        def make() -> None:
            create(new)

        self._show(
            "new take",
            "New take from footage",
            parts,
            [("create", "Make the take", make), ("close", "Cancel", self.close)],
            110,
        )

    def _look_again(self, new: NewTake, found: gui.Label) -> None:
        found.text = _found(new.found())
        take = self.widgets.get("take")
        if isinstance(take, gui.TextEdit) and not new.take:
            take.placeholder_text = new.proposed_take() or "a new folder"
        self._window.set_needs_layout()

    def preferences(self, now: Preferences, save: Callable[[Preferences], None]) -> None:
        """Picture size, background, playing at once."""
        self.widgets = {}
        chosen = replace(now, recent=list(now.recent))
        grid = gui.VGrid(2, 0.6 * self._em)
        size, background, play = gui.Combobox(), gui.Combobox(), gui.Checkbox("")
        for box, names, attribute in (
            (size, PICTURE_SIZES, "picture_size"),
            (background, BACKGROUND_NAMES, "background"),
        ):
            for name in names:
                box.add_item(name)
            box.selected_text = getattr(chosen, attribute)
            box.set_on_selection_changed(lambda text, _, attribute=attribute: setattr(chosen, attribute, text))
        play.checked = chosen.play_on_opening
        play.set_on_checked(lambda on: setattr(chosen, "play_on_opening", on))
        for label, widget in (
            ("Splats are drawn with at most", size),
            ("Background", background),
            ("Play on opening", play),
        ):
            grid.add_child(self._label(label))
            grid.add_child(widget)
        answers = [("save", "Save", self._closing(lambda: save(chosen))), ("close", "Cancel", self.close)]
        self._show("preferences", "Preferences", [grid], answers, 60)
        self.widgets |= {"picture_size": size, "background": background, "play": play}


def _broken(text: str) -> str:
    import textwrap

    return "\n".join(line for part in text.splitlines() for line in textwrap.wrap(part, 100) or [""])


def _found(text: str) -> str:
    """As many lines as the dialog has room for: it does not grow after it is shown."""
    lines = _broken(text).splitlines()[:FOUND_LINES]
    return "\n".join([*lines, *[" "] * (FOUND_LINES - len(lines))])
