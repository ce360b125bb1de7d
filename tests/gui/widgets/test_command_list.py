"""Commands are found by typing part of them."""

import numpy as np
import pytest

from gui.actions.menus import commands_of
from gui.drawing.palette import ACCENT_DARK
from gui.widgets.command_list import ROWS, CommandList, row_height, search

COMMANDS = commands_of(lambda item: "")


def keys(typed: str) -> list[str]:
    return [command.key for command in search(COMMANDS, typed)]


@pytest.mark.parametrize(
    ("typed", "first"),
    [("full", "fullscreen"), ("JOB lo", "log"), ("exp", "export"), ("url", "address")],
)
def test_parts_of_words_find_commands(typed: str, first: str) -> None:
    assert keys(typed)[0] == first


def test_words_may_be_in_any_order_and_nothing_shows_all() -> None:
    assert keys("view path") == keys("path view") == ["add_key"]
    assert keys("  ") == [command.key for command in COMMANDS]
    assert keys("no such thing") == []


def test_the_selected_command_stays_in_view() -> None:
    shown = CommandList(COMMANDS)
    em, height = 16.0, ROWS * row_height(16.0)
    for step in (1, 3, 30, 99, -2, -99):
        shown = shown.moved(step)
        assert 0 <= shown.at < len(COMMANDS)
        picture = shown.image(600, em)
        rows = np.flatnonzero((picture[:, 2] == ACCENT_DARK).all(axis=1))
        assert shown.row_at(rows.mean(), height) == shown.at
    assert CommandList([]).selected is None
    assert CommandList([]).moved(1).image(600, em).shape == (height, 600, 3)
