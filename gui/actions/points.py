"""Keys and buttons for marking points by hand."""

from collections.abc import Callable
from functools import partial
from typing import Any

from open3d.visualization import gui

from v3studio.gui.models.loop import later
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.calibrate.marks import TieMarks
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.form import ask_numbers
from v3studio.studio.errors import StudioError


class PointActions:
    """Names points that are marked by hand, and calibrates the cameras from them."""

    def __init__(self, workspace: Workspace, views: StageViews, dialogs: Dialogs) -> None:
        self._workspace, self._views, self._dialogs = workspace, views, dialogs
        views.points.described.connect(later(self._describe))
        views.points.run.connect(self._run)

    def keys(self) -> dict[Any, Callable[[], object]]:
        """Key bindings that replace the usual ones in the points view."""
        key, points = gui.KeyName, self._views.points
        if not self._views.edits_points:
            return {}
        return {
            key.N: partial(points.edit, TieMarks.add),
            key.E: self._describe,
            key.DELETE: points.unmark,
            key.BACKSPACE: points.unmark,
            key.A: points.toggle_snap,
            key.U: partial(points.edit, TieMarks.undo),
            key.C: lambda: points.step_camera(1),
            key.UP: lambda: points.step_point(-1),
            key.DOWN: lambda: points.step_point(1),
        }

    def _describe(self) -> None:
        marks = self._views.points.marks
        point = marks.point if marks is not None else None
        if marks is None or point is None:
            return
        place = " ".join(f"{coordinate:g}" for coordinate in point.world or ())
        fields = [("name", "Name", point.name), ("place", "Position (optional)", place)]
        text = "Position: as measured, x y z in meters, z up. Example: 0 0.3 0."
        ask_numbers(self._dialogs, "Edit point", text, fields, lambda typed: marks.describe(**typed))

    def _run(self) -> None:
        """Calibrate the take from these points."""
        points, workspace = self._views.points, self._workspace
        path, config = points.path, workspace.config
        if path is None or points.marks is None or not path.is_file():
            points.problem = "Mark points first."
            return
        if config is not None and not config.calibrate.tie_points:
            try:
                for name, setting in (("capture.rig", None), ("calibrate.tie_points", str(path.resolve()))):
                    workspace.change_settings({name: setting})
            except StudioError as error:
                points.problem = str(error)
                return
        if workspace.start("calibrate", again=False):
            self._views.select("calibrate")
