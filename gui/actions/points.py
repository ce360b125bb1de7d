"""Keys and buttons for marking points by hand."""

from collections.abc import Callable
from functools import partial
from typing import Any

from open3d.visualization import gui

from v3studio.gui.models.loop import later
from v3studio.gui.pages.calibrate.marks import TieMarks
from v3studio.gui.shell import Shell
from v3studio.gui.widgets.dialogs.form import ask_numbers
from v3studio.studio.errors import StudioError


def follow_points(window: Shell) -> None:
    """Do what the view's buttons need the window for. Call once."""
    window.views.points.described.connect(later(partial(_describe, window)))
    window.views.points.run.connect(partial(_run, window))


def point_keys(window: Shell) -> dict[Any, Callable[[], object]]:
    """Key bindings that replace the usual ones in the points view."""
    key, stage_view = gui.KeyName, window.views.points
    if not window.views.edits_points:
        return {}
    return {
        key.N: partial(stage_view.edit, TieMarks.add),
        key.E: partial(_describe, window),
        key.DELETE: stage_view.unmark,
        key.BACKSPACE: stage_view.unmark,
        key.A: stage_view.toggle_snap,
        key.U: partial(stage_view.edit, TieMarks.undo),
        key.C: lambda: stage_view.step_camera(1),
        key.UP: lambda: stage_view.step_point(-1),
        key.DOWN: lambda: stage_view.step_point(1),
    }


def _describe(window: Shell) -> None:
    marks = window.views.points.marks
    point = marks.point if marks is not None else None
    if marks is None or point is None:
        return
    place = " ".join(f"{value:g}" for value in point.world or ())
    fields = [("name", "Name", point.name), ("place", "Position (optional)", place)]
    text = "Position: as measured, x y z in meters, z up. Example: 0 0.3 0."
    ask_numbers(window.dialogs, "Edit point", text, fields, lambda typed: marks.describe(**typed))


def _run(window: Shell) -> None:
    """Calibrate the take from these points."""
    stage_view = window.views.points
    workspace, path = window.workspace, stage_view.path
    if path is None or stage_view.marks is None or not path.is_file():
        stage_view.problem = "Mark points first."
        return
    config = workspace.config
    if config is not None and not config.calibrate.tie_points:
        try:
            for name, value in (("capture.rig", None), ("calibrate.tie_points", str(path.resolve()))):
                workspace.change_settings({name: value})
        except StudioError as error:
            stage_view.problem = str(error)
            return
    if workspace.start("calibrate", again=False):
        window.views.select("calibrate")
