"""Commands are found by typing part of them."""

import pytest

from gui.actions.menus import commands_of
from gui.widgets.command_list import search

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
