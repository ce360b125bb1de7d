"""Title of the window, with the progress of a run."""

from __future__ import annotations

from gui.models.take.workspace import Workspace

PROGRAM = "V3 Studio"


def window_title(name: str, workspace: Workspace, queued: tuple[str, str, float | None] | None = None) -> str:
    """ "37% train - NAME - V3 Studio" while a run is in progress, else "NAME - V3 Studio".

    Args:
        name: what is open; "" if nothing is.
        workspace: its run.
        queued: name, stage and fraction of a take of the queue that runs; told if the open take does not.
    """
    if workspace.busy and workspace.run.stage:
        progress = workspace.run.progress
        words = run_words(workspace.run.stage, progress.fraction if progress is not None else None)
        return " - ".join(filter(None, (f"{words}, paused" if workspace.paused else words, name, PROGRAM)))
    if queued is not None:
        other, stage, fraction = queued
        return " - ".join(filter(None, (run_words(stage, fraction), other, PROGRAM)))
    return f"{name} - {PROGRAM}" if name else PROGRAM


def run_words(stage: str, fraction: float | None) -> str:
    """ "37% train"; only the stage if it has not told how far it is."""
    return stage if fraction is None else f"{int(100 * fraction)}% {stage}"
