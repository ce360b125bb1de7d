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
