"""What the buttons of the edits do that need a dialog."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from open3d.visualization import gui

from gui.actions.edits import EditActions
from gui.models.loop import LOOP, Signal
from gui.models.notices import Notices
from gui.models.playback.transport import Transport
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


def test_edits_are_taken_back_in_the_list(workspace: Workspace, take_copy: Path) -> None:
    workspace.open(Take.open(take_copy))
    editor = EditView(workspace)
    editor.begin(OrbitCamera(), np.array([0.0, 0.0, 1.0]), np.zeros((0, 3)))
    views = SimpleNamespace(editor=editor, edits_take=True, edit_dialog=Signal())
    view = SimpleNamespace(widget=SimpleNamespace(frame=gui.Rect(100, 50, 400, 200)))
    window: Any = SimpleNamespace(
        workspace=workspace, views=views, dialogs=Chosen(), start=SimpleNamespace(shown=False),
        viewport=SimpleNamespace(picture=view), input=SimpleNamespace(pointer=None),
        notices=Notices(), player=SimpleNamespace(refresh=lambda: None, transport=Transport(5, 25.0)),
        over_view=lambda x, y: False,
    )  # fmt: skip
    EditActions(window)
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
    editor.close()
