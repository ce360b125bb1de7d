from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from v3studio.gui.actions.runs import RunActions
from v3studio.gui.platform.closing import CloseRequests


@pytest.mark.parametrize(
    ("state", "answers"),
    [
        ({}, None),
        ({"job": 1}, ["leave", "stop", "stay"]),
        ({"job": 1, "paused": True}, ["resume", "leave", "stop", "stay"]),
        ({"paused": True}, ["resume", "leave", "stop", "stay"]),
        ({"exports": True}, ["leave", "stay"]),
    ],
)
def test_closing_asks_about_what_stays_behind(state: dict[str, object], answers: list[str] | None) -> None:
    workspace = MagicMock(job=state.get("job"), paused=state.get("paused", False))
    exports, dialogs = SimpleNamespace(running=state.get("exports"), does="export"), MagicMock()
    closing = CloseRequests(lambda: False)
    runs = RunActions(workspace, MagicMock(), exports, dialogs, closing)  # type: ignore[arg-type]
    closing.ask()
    assert runs.close_if_asked() == (answers is not None)
    if answers is None:
        assert closing.wanted
        return
    title, _, choices = dialogs.ask.call_args.args
    assert [key for key, _, _ in choices] == answers
    assert ("paused" in title) == ("paused" in state)
    choices[0][2]()
    assert closing.wanted
    assert workspace.pause.called == ("paused" in state)
