"""Initialize: the visual hull of each group's keyframe, and the initial points sampled on it."""

from bisect import bisect_right
from collections.abc import Hashable
from pathlib import Path

import numpy as np

from v3studio.gui.drawing.palette import DIM
from v3studio.gui.models.scene.contents import Cloud, SceneContents, cloud
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.scene.render import draw_contents
from v3studio.gui.models.take.workspace import Workspace, modified
from v3studio.gui.pages.choices import ViewMode
from v3studio.gui.pages.stage_view import OrbitView, Size
from v3studio.gui.widgets.raycast import RaycastMesh
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.results.point_files import read_points
from v3studio.pipelines.takes.results.stage_files import InitialPointsReport
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError
from v3studio.studio.memory_cache import MemoryCache
from v3studio.studio.own_frame import in_own_frame
from v3studio.studio.similarity import Similarity


class InitializeView(OrbitView):
    """The visual hull, or the initial points, of the group at the current frame."""

    modes = (ViewMode.MESH, ViewMode.POINTS)

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._groups: MemoryCache[Hashable, tuple[RaycastMesh, Cloud]] = MemoryCache(1)
        self._homes: MemoryCache[Hashable, OrbitCamera] = MemoryCache(1)

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
            raise StudioError("take.not_initialized", "no mesh and no points for this group yet", stage="initialize")
        mesh, points = self._groups.get_or_make(_stamp(folder), lambda _: _read(folder))
        # of another take, or calibrated again: where up is has changed
        self.home = self._homes.get_or_make((take.rig, modified(take.rig)), lambda _: _home(take, points[0]))
        contents = SceneContents(points=[points])
        if self.mode == ViewMode.MESH:
            contents = SceneContents(surfaces=[(mesh, Similarity())])
        canvas = draw_contents(contents, (self.orbit or self.home).camera(*size))
        path = folder / "report.json"
        keyframe = read_model(path, InitialPointsReport).keyframe if path.is_file() else "?"
        small = round(0.9 * self.em)
        group = int(folder.name.removeprefix("group_"))
        words = f"group {group}, frame {keyframe}: {counted(len(points[0]), 'point')}"
        words += f" on {counted(mesh.faces, 'triangle')}"
        canvas.text(self.em, 0.7 * self.em, words, small, DIM)
        return canvas.pixels

    def forget(self) -> None:
        """Free the mesh: Open3D exits with an error if one of its meshes outlives it."""
        super().forget()
        self._groups.clear()


def _read(folder: Path) -> tuple[RaycastMesh, Cloud]:
    return RaycastMesh(folder / "mesh.ply"), cloud(*read_points(folder / "points.ply"))


def _home(take: Take, points: np.ndarray) -> OrbitCamera:
    """The initial view: of all points, from the first camera's place."""
    if not take.rig.is_file():
        return OrbitCamera.showing(points, np.array([0.0, 0.0, 1.0]), None)
    rig = in_own_frame(read_rig(take.rig))
    return OrbitCamera.showing(points, rig.up, next(iter(rig), None))


def _stamp(folder: Path | None) -> Hashable:
    return folder and (folder, modified(folder / "mesh.ply"), modified(folder / "points.ply"))
