from __future__ import annotations

from gui.models.history import Change, History
from studio.errors import Message


def test_a_change_that_is_locked_for_now_stays() -> None:
    locked = [Message("settings.run_active", "settings are locked during a run")]
    history = History()
    history.add(Change("bake.quality 20 to 24", lambda: locked[0] if locked else None, lambda: None))
    assert history.undo() == "settings are locked during a run."
    locked.clear()
    assert history.undo() == "Undone: bake.quality 20 to 24."
    assert history.redo() == "Redone: bake.quality 20 to 24."
