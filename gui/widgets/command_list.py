"""The commands of the menus as a list that is searched by typing, and its image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from v3studio.gui.drawing.canvas import Canvas, text_width
from v3studio.gui.drawing.palette import ACCENT_DARK, DIALOG, DIM, LINE, TEXT

ROWS = 12  # rows of the image


@dataclass(frozen=True)
class Command:
    """An item of a menu. `reason`: why it is not possible now; "" if it is."""

    key: str
    menu: str
    words: str
    shortcut: str = ""
    reason: str = ""


def search(commands: Sequence[Command], typed: str) -> list[Command]:
    """The commands whose menu and words contain all typed words, in any order and case. First those whose words begin
    with what was typed, then those with a word that does, then the others; each in the order of the menus."""
    typed = " ".join(typed.casefold().split())

    def rank(command: Command) -> int:
        words = command.words.casefold()
        return 0 if words.startswith(typed) else 1 if f" {typed}" in f" {words}" else 2

    matches = [
        command
        for command in commands
        if all(part in f"{command.menu} {command.words}".casefold() for part in typed.split())
    ]
    return sorted(matches, key=rank) if typed else matches


@dataclass(frozen=True)
class CommandList:
    """The commands that are found, which one is selected (`at`), and which rows are in the image, from `first`."""

    found: Sequence[Command]
    at: int = 0
    first: int = 0

    @property
    def selected(self) -> Command | None:
        """The selected command; None if nothing is found."""
        return self.found[self.at] if self.at < len(self.found) else None

    def moved(self, rows: int) -> CommandList:
        """The list with another command selected, scrolled as far as that needs to be in view."""
        at = min(max(self.at + rows, 0), max(len(self.found) - 1, 0))
        return CommandList(self.found, at, min(max(self.first, at - ROWS + 1), at))

    def row_at(self, y: float, height: float) -> int | None:
        """The command at a row of pixels of an image so high; None if there is none."""
        row = self.first + int(y * ROWS // max(height, 1))
        return row if 0 <= row < len(self.found) else None

    @property
    def places(self) -> dict[str, list[float]]:
        """The middles of the rows in view, by their words, 0 to 1 across and down."""
        shown = self.found[self.first : self.first + ROWS]
        return {command.words: [0.5, round((row + 0.5) / ROWS, 3)] for row, command in enumerate(shown)}

    def image(self, width: int, em: float) -> np.ndarray:
        """(ROWS * row height, width, 3) uint8: menu, words and shortcut of each; of those that are not possible now,
        the reason. At the right, which part of the list that is, if it is not all of it."""
        row, size = row_height(em), round(0.9 * em)
        canvas = Canvas(width, ROWS * row, DIALOG)
        pad, menu_room = round(0.5 * em), 3.8 * em
        if not self.found:
            canvas.text(pad, (row - 1.25 * size) / 2, "No command has these words.", size, DIM)
        if len(self.found) > ROWS:
            share, thick = canvas.height / len(self.found), round(0.25 * em)
            width -= thick + 2
            canvas.rect(width + 2, 0, thick, canvas.height, LINE)
            canvas.rect(width + 2, self.first * share, thick, ROWS * share, DIM)
        for number, command in enumerate(self.found[self.first : self.first + ROWS]):
            y, selected = number * row, self.first + number == self.at
            if selected:
                canvas.rect(0, y, width, row, ACCENT_DARK)
            top = y + (row - 1.25 * size) / 2
            canvas.text(pad, top, command.menu, size, TEXT if selected else DIM, width=menu_room)
            left = pad + menu_room
            room = width - left - pad
            right = command.reason or command.shortcut
            color = DIM if command.reason else TEXT
            used = canvas.text(left, top, command.words, size, color, width=room)
            spare = room - used - em
            if right and spare > 2 * em:
                shown = min(text_width(right, size), spare)
                canvas.text(width - pad - shown, top, right, size, TEXT if selected else DIM, width=spare)
        return canvas.pixels


def row_height(em: float) -> int:
    """Pixels."""
    return round(1.6 * em)
