"""Dialogs over the window: something to read, questions, a line to type, one of a few lines."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial

from open3d.visualization import gui

from gui.panels.picture import color
from gui.platform.keyboard import send_tab
from gui.presenters.drawing.palette import ACCENT_DARK, DIM, RAISED

TAB_DOWN, TAB_UP = 3, 5
"""How often a dialog with a line has been drawn when Tab is pressed and released."""

Answer = tuple[str, str, Callable[[], None]]
"""Key, label, what to do."""


class Dialogs:
    """Shows one dialog at a time over a window.

    Attributes:
        widgets: of the open dialog, by key; empty where none is open.
        name: of the open dialog; "" where none is open.
        typing: its line has been given the keyboard.
    """

    def __init__(self, window: gui.Window) -> None:
        self._window = window
        self.em = window.theme.font_size
        self.widgets: dict[str, gui.Widget] = {}
        self.name = ""
        self.typing = False
        self._drawn: int | None = None
        self._on_enter: Callable[[], None] | None = None
        self._on_escape: Callable[[], None] = self.close

    def close(self) -> None:
        """Close what is open."""
        self._on_enter = self._drawn = None
        self.typing = False
        if self.name:
            self._window.close_dialog()
        self.widgets, self.name = {}, ""

    def show(
        self,
        name: str,
        title: str,
        parts: Sequence[gui.Widget],
        answers: Sequence[Answer],
        width: float,
        on_enter: Callable[[], None] | None = None,
        accent: str | None = None,
    ) -> None:
        """Show a dialog made of `parts`, in place of what is open.

        Args:
            name: it is known by.
            title: heading.
            parts: below each other.
            answers: buttons at the bottom.
            width: in letters, roughly.
            on_enter: what the Enter key does; None: nothing.
            accent: key of the answer that carries the accent; None: the first.
        """
        made = self.widgets
        self.close()
        self.widgets, self._on_enter = made, on_enter
        self._on_escape = next((action for key, _, action in answers if key == "close"), self.close)
        em = self.em
        dialog = gui.Dialog(title)
        column = gui.Vert(0.6 * em, gui.Margins(em, em, em, em))
        heading = gui.Label(title + " " * max(int(width - len(title)), 0))  # the widest line gives the dialog its width
        column.add_child(heading)
        for part in parts:
            column.add_child(part)
        row = gui.Horiz(0.5 * em)
        row.add_stretch()
        accent = answers[0][0] if accent is None else accent
        for key, label, action in answers:
            row.add_child(self.button(key, label, action, accent=key == accent))
        column.add_child(row)
        dialog.add_child(column)
        self.name = name
        self._window.show_dialog(dialog)

    def button(self, key: str, label: str, action: Callable[[], None], accent: bool = False) -> gui.Button:
        """A button of the dialog that is being made."""
        button = gui.Button(label)
        button.vertical_padding_em = 0.2
        button.background_color = color(ACCENT_DARK if accent else RAISED)
        button.set_on_clicked(action)
        self.widgets[key] = button
        return button

    def label(self, text: str, dim: bool = True) -> gui.Label:
        """Words of the dialog that is being made."""
        label = gui.Label(text)
        if dim:
            label.text_color = color(DIM)
        return label

    def laid_out(self) -> None:
        """Something of the dialog needs another place."""
        self._window.set_needs_layout()

    def enter(self) -> None:
        """The Enter key was released. Its press is no use: a field that is being edited keeps it for itself."""
        if self._on_enter is not None:
            self._on_enter()

    def tick(self) -> bool:
        """Call at each drawn tick: gives a new dialog's line the keyboard, once it has been drawn. Returns whether the
        window must be drawn again for that."""
        if self._drawn is None:
            return False
        self._drawn += 1
        if self._drawn == TAB_DOWN:
            send_tab(True)
        elif self._drawn == TAB_UP:
            self.typing = send_tab(False)
            self._drawn = None
        return True

    def escape(self) -> None:
        """The Escape key: as Cancel or Close, where there is one."""
        self._on_escape()

    def message(self, title: str, text: str) -> None:
        """Something to read."""
        self.widgets = {}
        self.show("message", title, [self.label(text, dim=False)], [("close", "Close", self.close)], 60, self.close)

    def ask(self, title: str, text: str, answers: Sequence[Answer]) -> None:
        """A question with answers; each closes the dialog first."""
        self.widgets = {}
        closing = [(key, label, self._closing(action)) for key, label, action in answers]
        self.show("ask", title, [self.label(text, dim=False)], closing, 60)

    def line(
        self, name: str, title: str, text: str, value: str, answers: Sequence[tuple[str, str, Callable[[str], None]]]
    ) -> None:
        """A line to type; answers get what was typed, the first one at Enter too."""
        self.widgets = {}
        edit = gui.TextEdit()
        edit.text_value = value
        typed = [value]

        def changed(now: str) -> None:
            typed[0] = now

        edit.set_on_text_changed(changed)

        def answer(action: Callable[[str], None]) -> Callable[[], None]:
            return self._closing(lambda: action(typed[0]))

        parts: list[gui.Widget] = [
            self.label(text),
            edit,
            self.label("Enter confirms. (A click or Tab goes into the line.)"),
        ]
        buttons: list[Answer] = [(key, label, answer(action)) for key, label, action in answers]
        self.show(name, title, parts, buttons, 70, buttons[0][2])
        self.widgets["line"] = edit
        self._drawn = 0

    def choose(
        self,
        name: str,
        title: str,
        choices: Sequence[str],
        chosen: Callable[[str], object],
        gone: Collection[str] = (),
        answers: Sequence[tuple[str, str, Callable[[], object]]] = (),
    ) -> None:
        """One of a few lines; those that are `gone` cannot be chosen. Answers stand before Close."""
        self.widgets = {}
        parts: list[gui.Widget] = []
        for number, choice in enumerate(choices):
            words = f"{choice}   (gone)" if choice in gone else choice
            button = self.button(f"choice{number}", words, self._closing(partial(chosen, choice)))
            button.enabled = choice not in gone
            parts.append(button)
        if not choices:
            parts.append(self.label("There is nothing here yet."))
        row: list[Answer] = [(key, label, self._closing(action)) for key, label, action in answers]
        row.append(("close", "Close", self.close))
        self.show(name, title, parts, row, 60, accent="close")

    def _closing(self, action: Callable[[], object]) -> Callable[[], None]:
        def go() -> None:
            self.close()
            action()

        return go


def broken(text: str) -> str:
    """Lines no longer than a dialog is wide."""
    import textwrap

    return "\n".join(line for part in text.splitlines() for line in textwrap.wrap(part, 100) or [""])
