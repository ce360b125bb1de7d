"""The dialog of the queue while the start page polls the same queue."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from gui.actions.queue import QueueActions
from gui.models.take.take_queue import TakeQueue
from gui.widgets.dialogs.queue import NAME
from pipelines.batch.queue_file import QueueFile
from tests.support.waiting import wait_until


def test_the_dialog_follows_what_the_start_page_has_read(tmp_path: Path) -> None:
    window: Any = SimpleNamespace(dialogs=SimpleNamespace(name=NAME))
    actions: Any = QueueActions(window)
    file = QueueFile(tmp_path / "queue.json")
    actions.queue = TakeQueue(file)
    updates: list[int] = []
    actions._dialog = SimpleNamespace(update=lambda: updates.append(len(actions.queue.view.rows)))
    actions._shown = actions.queue.state
    file.add(tmp_path / "take", None, ())
    try:
        wait_until("what the page reads", lambda: actions.queue.poll() and len(actions.queue.view.rows) == 1)
        assert actions.poll()
        assert not actions.poll()
        assert updates == [1]
    finally:
        actions.close()
