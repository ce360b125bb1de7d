from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
from open3d.visualization import gui

from v3studio.gui.actions.commands import Actions


@pytest.mark.parametrize("name", ["O", "SPACE", "S", "W", "F", "X", "L", "J"])
def test_a_held_key_that_switches_acts_once(name: str) -> None:
    event = SimpleNamespace(key=getattr(gui.KeyName, name))
    actions = Actions(MagicMock())
    assert actions.for_key(event) is not None
    assert actions.for_key(event, again=True) is None
