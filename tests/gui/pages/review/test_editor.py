"""The model of the edits: nothing is drawn."""

from pathlib import Path

import numpy as np
import pytest

from tests.support.looping import heard
from v3studio.gui.models.playback.viewpoint import Viewpoint
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.review.editor import Editor, Measured
from v3studio.pipelines.takes.take import Take
from v3studio.studio.edits import EditList, Floaters, Trim

EYE = np.array([0.0, -5.0, 0.0])


@pytest.fixture
def editor(workspace: Workspace, take_copy: Path) -> Editor:
    workspace.open(Take.open(take_copy))
    return Editor(workspace, Viewpoint())


def test_trims_to_the_current_frame_and_the_whole_take_is_no_trim(editor: Editor) -> None:
    editor.frame = 1
    editor.press("in")
    assert editor.edits.trim == Trim(first=1, last=4)
    editor.frame = 3
    editor.press("out")
    assert editor.edits.trim == Trim(first=1, last=3)
    assert "trim to frames 1 to 3" in editor.status
    editor.frame = 4
    editor.press("in")
    assert editor.edits.trim == Trim(first=4, last=4)
    editor.frame = 0
    editor.press("in")
    assert editor.edits == EditList()


def test_tools_begin_with_what_was_measured_and_another_tool_lets_go_of_it(editor: Editor) -> None:
    chosen = heard(editor.tool_chosen)
    editor.press("floaters")
    assert editor.pending is None, "nothing was drawn"
    editor.measured = Measured(np.array([EYE]), proposed=Floaters(opacity=0.1))
    assert editor.suggest()
    assert editor.pending == EditList(floaters=Floaters(opacity=0.1))
    editor.press("ground")
    assert editor.pending is not None
    assert editor.pending.ground is not None
    assert editor.pending.floaters is None
    editor.press("orbit")
    assert editor.pending is None
    assert len(chosen) == 3


def test_a_change_is_refused_without_a_selection_or_a_take(editor: Editor) -> None:
    refused = heard(editor.refusal)
    editor.press("remove")
    assert len(refused) == 1
    assert editor.idle_buttons == {"remove"}
    editor.press("scale")
    points = heard(editor.two_points)
    for height in (0.0, 0.0, 2.0):  # the second click is at the first one, and does not count
        editor.pick(np.array([0.0, 0.0, height]), EYE)
    ((start, end),) = points
    assert isinstance(start, np.ndarray)
    assert isinstance(end, np.ndarray)
    for distance in (0.0, -1.0, 1e9):
        assert editor.set_scale(start, end, distance), "why not"
    assert editor.edits == EditList()
    assert not editor.set_scale(start, end, 1.0)
    assert editor.edits.similarity.scale == pytest.approx(0.5)
    editor.workspace.open(None)
    assert editor.commit(EditList(trim=Trim(first=0, last=1)), "trim")
    assert len(refused) == 5
