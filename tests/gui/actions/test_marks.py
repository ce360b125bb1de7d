from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from v3studio.gui.actions.marks import ask_mark, go_to_next
from v3studio.gui.models.history import History
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.transport import Transport
from v3studio.pipelines.takes.authored.marks import Mark, change_mark, read_marks
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers

ANNAS = Mark(frame=0, note="foot", author="Anna")


class Window:
    """What the actions use of the main window; its dialog keeps what can be answered."""

    def __init__(self, path: Path) -> None:
        self.marks = Marks(path)
        self.player = PlayerPresenter()
        self.player.opened = SimpleNamespace(rig=None, sources={})  # type: ignore[assignment]
        self.workspace, self.notices = SimpleNamespace(history=History()), Notices()
        self.dialogs = SimpleNamespace(line=self._line)
        self.answers: dict[str, Callable[[str], None]] = {}

    def _line(self, kind: str, title: str, text: str, note: str, *answers: Any) -> None:
        self.answers = {name: act for name, _, act in answers}


@pytest.fixture
def window(tmp_path: Path) -> Window:
    return Window(tmp_path / "marks.json")


def test_a_mark_stays_with_the_footage_when_the_take_begins_later(window: Window, tmp_path: Path) -> None:
    window.player.transport = Transport(5, 25.0)
    window.player.transport.numbers = FrameNumbers((60, 61, 62, 63, 64))
    window.player.transport.seek(3)
    ask_mark(window)  # type: ignore[arg-type]
    window.answers["save"]("hand")
    assert list(read_marks(tmp_path / "marks.json")) == [63]
    window.player.transport.numbers = FrameNumbers((62, 63, 64))  # capture.frames is 62: now
    window.player.transport.seek(0)
    go_to_next(window, 1)  # type: ignore[arg-type]
    assert window.player.transport.frame == 1
    window.player.transport.numbers = FrameNumbers((64,))
    go_to_next(window, -1)  # type: ignore[arg-type]
    assert "does not have frame 63" in window.notices.text


@pytest.mark.parametrize("answer", ["save", "remove"])
def test_undo_leaves_what_somebody_else_wrote_meanwhile(window: Window, tmp_path: Path, answer: str) -> None:
    path = tmp_path / "marks.json"
    window.marks.set(0, "hand", None)
    ask_mark(window)  # type: ignore[arg-type]
    change_mark(path, 0, ANNAS, window.marks.marks[0])
    assert window.marks.refresh(), "the window shows it at once"
    window.answers[answer]("head")
    assert "changed in the meantime" in window.notices.text
    assert window.workspace.history.undo() == "Nothing to undo."
    assert read_marks(path) == {0: ANNAS}
