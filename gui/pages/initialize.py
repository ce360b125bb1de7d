"""Initialize: the visual hull of each group's keyframe, and the initial points sampled on it."""

from bisect import bisect_right
from collections.abc import Hashable
from pathlib import Path

import numpy as np

from gui.drawing.palette import DIM
from gui.models.scene.contents import SceneContents, cloud
from gui.models.scene.orbit import OrbitCamera
from gui.models.scene.render import draw_contents
from gui.models.take.workspace import Workspace, modified
from gui.pages.stage_view import OrbitView, Size
from gui.widgets.raycast import RaycastMesh
from pipelines.takes.atomic_files import read_model
from pipelines.takes.point_files import read_points
from pipelines.takes.stage_files import InitialPointsReport
from pipelines.takes.take import Take
from studio.camera_files import read_rig
from studio.counts import counted
from studio.errors import StudioError
from studio.own_frame import in_own_frame
from studio.similarity import Similarity


class InitializeView(OrbitView):
    """See the module."""

    modes = ("mesh", "points")

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._read_of: Hashable = None
        self._rig_of: Hashable = None
        self._mesh: RaycastMesh | None = None
        self._points = cloud(np.zeros((0, 3)), np.zeros((0, 3)))

    def _folder(self) -> Path | None:
        """Folder of the current frame's group."""
        take = self.workspace.take
        if take is None:
            return None
        starts = self.workspace.assessment.group_starts
        return take.initialize_group(max(bisect_right(starts, self.frame) - 1, 0))

    def state(self) -> Hashable:
        """The files of the group, and the view."""
        folder = self._folder()
        view = self.orbit.key if self.orbit is not None else None
        return (_stamp(folder), self.mode, view, self.em)

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        folder = self._folder()
        take = self.workspace.take
        if folder is None or take is None or not (folder / "points.ply").is_file():
            raise StudioError("take.not_initialized", "no mesh and no points for this group yet", fix="Run Initialize.")
        self._read(take, folder)
        view = (self.orbit or self.home or OrbitCamera()).camera(*size)
        assert self._mesh is not None
        mesh = SceneContents(surfaces=[(self._mesh, Similarity())])
        canvas = draw_contents(mesh if self.mode == "mesh" else SceneContents(points=[self._points]), view)
        path = folder / "report.json"
        keyframe = read_model(path, InitialPointsReport).keyframe if path.is_file() else "?"
        small = round(0.9 * self.em)
        group = int(folder.name.removeprefix("group_"))
        words = f"group {group}, frame {keyframe}: {counted(len(self._points[0]), 'point')}"
        words += f" on {counted(self._mesh.faces, 'triangle')}"
        canvas.text(self.em, 0.7 * self.em, words, small, DIM)
        return canvas.pixels

    def _read(self, take: Take, folder: Path) -> None:
        stamp = _stamp(folder)
        if stamp == self._read_of:
            return
        rig_of = (take.rig, modified(take.rig))
        self._points = cloud(*read_points(folder / "points.ply"))
        self._mesh = RaycastMesh(folder / "mesh.ply")
        if rig_of != self._rig_of:  # of another take, or calibrated again: where up is has changed
            self.home, self._rig_of = _home(take, self._points[0]), rig_of
        self._read_of = stamp

    def close(self) -> bool:
        """See `StageView`. Open3D exits with an error if one of its meshes outlives it."""
        ended = super().close()
        self._mesh = None
        return ended


def _home(take: Take, points: np.ndarray) -> OrbitCamera:
    """The initial view: of all points, from the first camera's place."""
    if not take.rig.is_file():
        return OrbitCamera.showing(points, np.array([0.0, 0.0, 1.0]), None)
    rig = in_own_frame(read_rig(take.rig))
    return OrbitCamera.showing(points, rig.up, next(iter(rig), None))


def _stamp(folder: Path | None) -> Hashable:
    return folder and (folder, modified(folder / "mesh.ply"), modified(folder / "points.ply"))
