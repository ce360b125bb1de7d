"""Changes of a take's edits from the window, noted for undo."""

from gui.models.history import Change
from gui.models.take.workspace import Workspace
from pipelines.takes.edits import change_edits
from studio.edits.edit_list import EditList
from studio.errors import Message, StudioError


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
    refused = _write(workspace, before, edits, words)
    if refused is not None:
        return str(refused)
    workspace.history.add(
        Change(
            words,
            lambda: _write(workspace, edits, before, f"undo: {words}"),
            lambda: _write(workspace, before, edits, words),
        )
    )
    return ""


def _write(workspace: Workspace, before: EditList, edits: EditList, words: str) -> Message | None:
    if workspace.take is None or workspace.context is None:
        return Message("edits.no_take", "no take with readable settings is open", fix="Open a take first.")
    try:
        change_edits(workspace.take.edits, edits, words, before)
    except StudioError as error:
        return error.message
    workspace.inputs_changed()
    return None
