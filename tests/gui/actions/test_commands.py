from dataclasses import fields
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest
from open3d.visualization import gui

from v3studio.gui.actions.commands import ITEMS, Actions
from v3studio.gui.models.marks import Marks


def actions(**groups: Any) -> Actions:
    """Actions whose groups are stand-ins, without keys of their own."""
    stand_ins = {field.name: MagicMock(keys=dict) for field in fields(Actions)}
    return Actions(**{**stand_ins, **groups})


@pytest.mark.parametrize("name", ["O", "SPACE", "S", "W", "F", "X", "L", "J"])
def test_a_held_key_that_switches_acts_once(name: str) -> None:
    event: Any = SimpleNamespace(key=getattr(gui.KeyName, name))
    assert actions().for_key(event) is not None
    assert actions().for_key(event, again=True) is None


@pytest.mark.parametrize(
    ("item", "opened", "why"),
    [
        ("quit", None, ""),
        ("reset", None, "No take or stream is open."),
        ("report", SimpleNamespace(take=None, sources={}), "No take is open."),
        ("export", SimpleNamespace(take=None, sources={}), "Nothing is trained yet."),
        ("export", SimpleNamespace(take=None, sources={"decoded": None}), ""),
        ("next_mark", SimpleNamespace(take=None, sources={}), "No marks yet. M makes one."),
        ("mark", SimpleNamespace(take=None, sources={}), ""),
    ],
)
def test_a_command_says_why_it_is_not_possible(item: str, opened: Any, why: str) -> None:
    workspace = SimpleNamespace(opening="")
    do = actions(player=SimpleNamespace(opened=opened), marks=SimpleNamespace(marks=Marks()), workspace=workspace)
    assert do.why_not(ITEMS[item]) == why
    workspace.opening = "walk"
    assert "walk" in do.why_not(ITEMS["reset"]) or opened, "it is about to be open"


def test_every_command_acts_on_a_group_of_actions() -> None:
    for item in ITEMS.values():
        item.act(actions())
