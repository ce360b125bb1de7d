"""Changes of a take's edits from the window, noted for undo."""

from functools import partial

from gui.models.history import Change
from gui.models.take.workspace import Workspace
from pipelines.takes.edits import change_edits
from studio.edits.edit_list import EditList
from studio.errors import StudioError


def edits_of(workspace: Workspace) -> EditList:
    """The edits of the open take; none if no take is open, or they cannot be read."""
    try:
        return workspace.context.edits if workspace.context is not None else EditList()
    except StudioError:
        return EditList()


def change(workspace: Workspace, edits: EditList, words: str) -> str:
    """Write the edits of the open take as one change, which can be undone; return "", or why it was refused."""
    before = edits_of(workspace)
    if edits == before:
        return ""
    undo = partial(_write, workspace, edits, before, f"undo: {words}")
    redo = partial(_write, workspace, before, edits, words)
    try:
        redo()
    except StudioError as error:
        return str(error)
    workspace.history.add(Change(words, undo, redo))
    return ""


def _write(workspace: Workspace, before: EditList, edits: EditList, words: str) -> None:
    if workspace.take is None or workspace.context is None:
        raise StudioError("edits.no_take", "no take with readable settings is open", fix="Open a take first.")
    change_edits(workspace.take.edits, edits, words, before)
    workspace.inputs_changed()
