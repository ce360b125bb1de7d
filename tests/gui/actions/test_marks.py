from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from v3studio.gui.actions.marks import MarkActions, show_view, view_of
from v3studio.gui.models.history import History
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.transport import Transport
from v3studio.pipelines.takes.authored.marks import Mark, change_mark, read_marks
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers

ANNAS = Mark(frame=0, note="foot", author="Anna")


class Marking:
    """The actions with what they use; their dialog keeps what can be answered."""

    def __init__(self, path: Path) -> None:
        self.marks, self.player, self.notices, self.history = Marks(path), PlayerPresenter(), Notices(), History()
        self.player.opened = SimpleNamespace(rig=None, sources={})  # type: ignore[assignment]
        workspace: Any = SimpleNamespace(history=self.history)
        dialogs: Any = SimpleNamespace(line=self._line)
        self.actions = MarkActions(self.player, self.marks, workspace, dialogs, self.notices)
        self.answers: dict[str, Callable[[str], None]] = {}

    def _line(self, kind: str, title: str, text: str, note: str, *answers: Any) -> None:
        self.answers = {name: act for name, _, act in answers}


@pytest.fixture
def marking(tmp_path: Path) -> Marking:
    return Marking(tmp_path / "marks.json")


def test_a_mark_stays_with_the_footage_when_the_take_begins_later(marking: Marking, tmp_path: Path) -> None:
    marking.player.transport = Transport(5, 25.0)
    marking.player.transport.numbers = FrameNumbers((60, 61, 62, 63, 64))
    marking.player.transport.seek(3)
    marking.actions.ask()
    marking.answers["save"]("hand")
    assert list(read_marks(tmp_path / "marks.json")) == [63]
    marking.player.transport.numbers = FrameNumbers((62, 63, 64))  # capture.frames is 62: now
    marking.player.transport.seek(0)
    marking.actions.go_to_next(1)
    assert marking.player.transport.frame == 1
    marking.player.transport.numbers = FrameNumbers((64,))
    marking.actions.go_to_next(-1)
    assert "does not have frame 63" in marking.notices.text


def test_going_to_a_mark_leaves_the_heat_map_on(player: PlayerPresenter) -> None:
    player.look_through("cam4")
    player.choose_mode("difference")
    show_view(player, view_of(player))
    assert player.mode == "difference"


@pytest.mark.parametrize("answer", ["save", "remove"])
def test_undo_leaves_what_somebody_else_wrote_meanwhile(marking: Marking, tmp_path: Path, answer: str) -> None:
    path = tmp_path / "marks.json"
    marking.marks.set(0, "hand", None)
    marking.actions.ask()
    change_mark(path, 0, ANNAS, marking.marks.marks[0])
    assert marking.marks.refresh(), "the window shows it at once"
    marking.answers[answer]("head")
    assert "changed in the meantime" in marking.notices.text
    assert marking.history.undo() == "Nothing to undo."
    assert read_marks(path) == {0: ANNAS}
