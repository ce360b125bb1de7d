"""What the buttons of the edits do that need a dialog."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from open3d.visualization import gui

from gui.actions.edits import EditActions
from gui.models.loop import LOOP, Signal
from gui.models.notices import Notices
from gui.models.scene.orbit import OrbitCamera
from gui.models.take.workspace import Workspace
from gui.pages.review.view import EditView
from pipelines.takes.edits import read_edits
from pipelines.takes.take import Take
from studio.edits import EditList, Floaters, Trim


class Chosen:
    """Dialogs that note what is asked."""

    name = ""

    def choose(self, name: str, title: str, lines: list[str], chosen: Any, answers: Any = ()) -> None:
        self.lines, self.chosen, self.answers = lines, chosen, answers


@pytest.fixture
def window(take_copy: Path):
    workspace = Workspace()
    workspace.open(Take.open(take_copy))
    editor = EditView(workspace)
    editor.begin(OrbitCamera(), np.array([0.0, 0.0, 1.0]), np.zeros((0, 3)))
    views = SimpleNamespace(editor=editor, edits_take=True, edit_dialog=Signal())
    view = SimpleNamespace(widget=SimpleNamespace(frame=gui.Rect(100, 50, 400, 200)))
    yield SimpleNamespace(
        workspace=workspace, views=views, dialogs=Chosen(), start=SimpleNamespace(shown=False),
        viewport=SimpleNamespace(picture=view), input=SimpleNamespace(pointer=None),
        notices=Notices(), player=SimpleNamespace(refresh=lambda: None),
        over_view=lambda x, y: False,
    )  # fmt: skip
    editor.close()
    workspace.close()


def test_edits_are_taken_back_in_the_list(window: Any) -> None:
    EditActions(window)
    editor = window.views.editor
    edits = EditList(trim=Trim(first=0, last=2), floaters=Floaters(opacity=0.05))
    assert editor.commit(edits, "both")
    window.views.edit_dialog.emit("list")
    LOOP.run()
    dialogs = window.dialogs
    assert [line.partition(":")[0] for line in dialogs.lines] == ["Take back trim", "Take back floaters"]
    assert all("emove" not in words for words in (*dialogs.lines, *(label for _, label, _ in dialogs.answers)))
    dialogs.chosen(dialogs.lines[1])
    file = window.workspace.take.edits
    assert read_edits(file) == EditList(trim=Trim(first=0, last=2))
    assert window.workspace.history.undo() == "Undone: floaters taken back."
    ((_, _, take_back_all),) = dialogs.answers
    take_back_all()
    assert read_edits(file) == EditList()


def test_keys_change_the_brush_while_it_is_chosen(window: Any) -> None:
    actions, editor, key = EditActions(window), window.views.editor, gui.KeyName
    assert actions.keys() == {}
    editor.choose_tool("brush")
    before = editor.brush
    actions.keys()[key.PLUS]()
    assert editor.brush > before
    actions.keys()[key.MINUS]()
    assert editor.brush == pytest.approx(before)
    window.views.edits_take = False
    assert actions.keys() == {}


def test_numbers_of_the_brush_are_its_radius(window: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr("gui.actions.edits.ask_numbers", lambda *of: asked.append(of))
    EditActions(window)
    editor = window.views.editor
    editor.choose_tool("brush")
    editor.brush = 0.0312345
    window.views.edit_dialog.emit("numbers")
    LOOP.run()
    ((_, title, _, fields, save),) = asked
    assert (title, fields[0][2]) == ("Brush", "3.12")
    assert save({"radius": "3.12"}) == ""
    assert editor.brush == 0.0312345, "what was not changed is not rounded"
    assert save({"radius": "500"}) != ""
    assert save({"radius": "6"}) == ""
    assert editor.brush == pytest.approx(0.06)


def test_the_pointer_is_known_over_the_view_alone(window: Any) -> None:
    actions, editor = EditActions(window), window.views.editor
    window.input.pointer = (200, 100)
    actions.moved()
    assert editor.pointer is None, "without a brush"
    editor.choose_tool("brush")
    for pointer, place in (((200, 100), (0.25, 0.25)), ((50, 100), None), (None, None), ((499, 50), (0.9975, 0.0))):
        window.input.pointer = pointer
        actions.moved()
        assert editor.pointer == (place and pytest.approx(place))
    window.over_view = lambda x, y: y < 80
    actions.moved()
    assert editor.pointer is None, "under a notice"
    window.over_view = lambda x, y: False
    window.dialogs.name = "numbers"
    actions.moved()
    assert editor.pointer is None, "under a dialog"
