"""Commands are found by typing part of them."""

from __future__ import annotations

import numpy as np
import pytest

from gui.actions.menus import MENUS
from gui.drawing.palette import ACCENT_DARK, DIM
from gui.widgets.command_list import ROWS, Command, CommandList, row_height, search

COMMANDS = [Command.of(key, title, label) for title, items in MENUS for key, label in items if key]


def keys(typed: str) -> list[str]:
    return [command.key for command in search(COMMANDS, typed)]


def test_labels_of_menus_are_taken_apart() -> None:
    by_key = {command.key: command for command in COMMANDS}
    assert by_key["mark"] == Command("mark", "Mark", "Mark frame", "M")
    assert by_key["previous_mark"].shortcut == "<"
    assert by_key["redo"].shortcut == "Ctrl+Shift+Z"
    assert by_key["quit"] == Command("quit", "File", "Quit")
    assert not any("(" in command.words or command.words.endswith("...") for command in COMMANDS)


@pytest.mark.parametrize(
    ("typed", "first"),
    [("full", "fullscreen"), ("JOB lo", "log"), ("export turn", "export turntable"), ("url", "address")],
)
def test_parts_of_words_find_commands(typed: str, first: str) -> None:
    assert keys(typed)[0] == first


def test_words_may_be_in_any_order_and_nothing_shows_all() -> None:
    assert keys("movie path") == keys("path movie") == ["export camera-path"]
    assert keys("  ") == [command.key for command in COMMANDS]
    assert keys("no such thing") == []


def test_the_selected_command_stays_in_view() -> None:
    shown = CommandList(COMMANDS)
    em, height = 16.0, ROWS * row_height(16.0)
    for step in (1, 3, 30, 99, -2, -99):
        shown = shown.moved(step)
        assert 0 <= shown.at < len(COMMANDS)
        picture = shown.picture(600, em)
        rows = np.flatnonzero((picture[:, 2] == ACCENT_DARK).all(axis=1))
        assert shown.row_at(rows.mean(), height) == shown.at
    assert CommandList([]).selected is None
    assert CommandList([]).moved(1).picture(600, em).shape == (height, 600, 3)


def test_a_bar_shows_which_part_of_the_list_that_is() -> None:
    for first in (0, 5, len(COMMANDS) - ROWS):
        picture = CommandList(COMMANDS, first, first).picture(600, 16.0)
        bar = np.flatnonzero((picture[:, -2] == DIM).all(axis=1)) / len(picture) * len(COMMANDS)
        assert [bar.min(), bar.max()] == pytest.approx([first, first + ROWS], abs=0.3)
    picture = CommandList(COMMANDS[:ROWS]).picture(600, 16.0)
    assert not (picture[:, -2] == DIM).all(axis=1).any()
