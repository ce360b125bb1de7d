from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.looping import wait_in_loop
from tests.support.players import newest
from v3studio.gui.actions.edits import EditActions
from v3studio.gui.models.loop import LOOP, Signal
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.sources import TrainedSource
from v3studio.gui.models.playback.transport import Transport
from v3studio.gui.models.playback.viewpoint import Viewpoint
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.review.editor import Editor
from v3studio.gui.pages.review.view import EditView
from v3studio.pipelines.takes.authored.edits import read_edits
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig
from v3studio.studio.edits import EditList, Floaters, Trim


class Chosen:
    """Dialogs that note what is asked."""

    name = ""

    def choose(self, name: str, title: str, lines: list[str], chosen: Any, answers: Any = (), note: str = "") -> None:
        self.name, self.lines, self.chosen, self.answers = name, lines, chosen, answers
        self.widgets = {f"choice{number}": SimpleNamespace() for number in range(len(lines))}


class Edited:
    """The finished take with its edits, and a dialog that notes what is asked."""

    def __init__(self, workspace: Workspace, take: Path) -> None:
        self.workspace, self.dialogs, self.transport = workspace, Chosen(), Transport(5, 25.0)
        workspace.open(Take.open(take))
        viewpoint, rig = Viewpoint(), read_rig(take / "calibrate" / "rig.json")
        viewpoint.orbit = OrbitCamera.looking_through(rig["cam0"], np.zeros(3), np.array([0.0, 0.0, 1.0]))
        self.editor, self.edit_dialog = Editor(workspace, viewpoint), Signal[[str]]()
        self.view = EditView(self.editor)
        views: Any = SimpleNamespace(editor=self.editor, edits_take=True, edit_dialog=self.edit_dialog)
        player: Any = SimpleNamespace(refresh=lambda: None, transport=self.transport)
        dialogs: Any = self.dialogs
        EditActions(player, workspace, views, dialogs, Notices(), lambda: None)


@pytest.fixture
def edited(workspace: Workspace, take_copy: Path) -> Edited:
    return Edited(workspace, take_copy)


def splats(take: Path) -> list[int]:
    """Number of splats of each frame that are left by the edits."""
    source = TrainedSource(Take.open(take), 25.0)
    return [len(source.gaussians(frame)) for frame in range(source.frame_count)]


@pytest.mark.parametrize(("choice", "frames"), [(0, (0, 0)), (1, (1, 3)), (2, None)])
def test_what_is_selected_is_removed_from_the_chosen_frames(
    edited: Edited, take_copy: Path, choice: int, frames: tuple[int, int] | None
) -> None:
    editor, view, dialogs, there = edited.editor, edited.view, edited.dialogs, splats(take_copy)
    newest(lambda: view.poll((320, 240)), lambda: view.settled)
    edited.transport.select_span(1, 3)
    editor.press("brush")
    assert view.grabs(150, 120)
    view.pull(170, 120)
    view.release()
    newest(lambda: view.poll((320, 240)), lambda: view.settled)
    selected = editor.measured.selected
    editor.press("remove")
    LOOP.run()
    told = list(dialogs.lines)
    wait_in_loop("counts", lambda: dialogs.lines != told)
    dialogs.chosen(told[choice])
    (region,) = read_edits(take_copy / "edits.json").regions
    assert region.frames == frames
    gone = [before - now for before, now in zip(there, splats(take_copy), strict=True)]
    assert gone == [selected] * 3 + [gone[-1]] * 2, "the same in all frames of a group"
    assert (gone[-1] > 0) == (choice > 0), "of the second group only where it was chosen"
    assert int(dialogs.lines[choice].rpartition(": ")[2].split()[0]) == selected + gone[-1], "the count shown before"


def test_edits_are_taken_back_in_the_list(edited: Edited) -> None:
    editor = edited.editor
    edits = EditList(trim=Trim(first=0, last=2), floaters=Floaters(opacity=0.05))
    assert not editor.commit(edits, "both")
    edited.edit_dialog.emit("list")
    LOOP.run()
    dialogs = edited.dialogs
    assert [line.partition(":")[0] for line in dialogs.lines] == ["Take back trim", "Take back floaters"]
    assert all("emove" not in words for words in (*dialogs.lines, *(label for _, label, _ in dialogs.answers)))
    dialogs.chosen(dialogs.lines[1])
    file = edited.workspace.take.edits
    assert read_edits(file) == EditList(trim=Trim(first=0, last=2))
    assert edited.workspace.history.undo() == "Undone: floaters taken back."
    ((_, _, take_back_all),) = dialogs.answers
    take_back_all()
    assert read_edits(file) == EditList()
