"""The dialog of the queue follows the queue."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gui.actions.queue import QueueActions
from gui.models.take.take_queue import TakeQueue
from gui.widgets.dialogs.queue import NAME
from pipelines.batch.queue_file import QueueFile
from tests.support.looping import wait_in_loop


def test_the_dialog_follows_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    window: Any = SimpleNamespace(dialogs=SimpleNamespace(name=NAME), start=SimpleNamespace(shown=False))
    file = QueueFile(tmp_path / "queue.json")
    monkeypatch.setattr("gui.actions.queue.TakeQueue", lambda: TakeQueue(file))
    actions: Any = QueueActions(window)
    updates: list[int] = []
    actions._dialog = SimpleNamespace(update=lambda: updates.append(len(actions.queue.view.rows)))
    file.add(tmp_path / "take", None, ())
    try:
        wait_in_loop("an update", lambda: updates == [1])
    finally:
        actions.close()
