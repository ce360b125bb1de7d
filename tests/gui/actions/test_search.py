"""What the list of commands says of commands that are not possible."""

from __future__ import annotations

from unittest.mock import MagicMock

from gui.actions.search import SearchActions
from gui.models.history import Change, History


def test_what_can_be_done_without_a_take_is_not_refused() -> None:
    window = MagicMock()
    window.workspace.take = None
    window.workspace.history = history = History()
    search = SearchActions(window, dict)
    assert search.why_not("undo") == "nothing to undo"
    history.add(Change("a mark", lambda: None, lambda: None))
    assert search.why_not("undo") == ""
    assert search.why_not("redo") == "nothing to redo"
    history.undo()
    assert search.why_not("redo") == ""
    assert search.why_not("report") == "no take is open"
    window.player.opened = None
    assert search.why_not("fullscreen") == ""
    assert search.why_not("screenshot") == "nothing is open"
