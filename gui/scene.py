"""Open3D's own scene in place of the picture: smooth on a real GPU, slow where the processor draws."""

from __future__ import annotations

import numpy as np
import open3d as o3d
from open3d.visualization import gui, rendering

from gui.presenters.palette import GROUND, SECOND
from gui.presenters.scene_parts import SceneParts

_FIELD = 50.0


class SceneView:
    """A scene widget that shows `SceneParts`. Drags turn, the wheel goes nearer, as Open3D does it.

    Args:
        window: that draws it; the widget must still be added to it.
    """

    def __init__(self, window: gui.Window) -> None:
        self.widget = gui.SceneWidget()
        self.widget.scene = rendering.Open3DScene(window.renderer)
        self.widget.scene.set_background([*(value / 255 for value in GROUND), 1.0])
        self.widget.scene.show_skybox(False)
        self.widget.visible = False
        self._stamp: object = None
        self._parts: SceneParts | None = None

    def show(self, parts: SceneParts) -> bool:
        """Put geometry up; returns whether it is other than before."""
        if parts.stamp == self._stamp:
            return False
        self._stamp, self._parts = parts.stamp, parts
        scene = self.widget.scene
        scene.clear_geometry()
        if len(parts.points):
            cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(parts.points))
            cloud.colors = o3d.utility.Vector3dVector(parts.colors)
            scene.add_geometry("points", cloud, _material("defaultUnlit", point_size=3.0))
        if len(parts.lines):
            ends = np.arange(2 * len(parts.lines)).reshape(-1, 2)
            lines = o3d.geometry.LineSet(
                o3d.utility.Vector3dVector(parts.lines.reshape(-1, 3)), o3d.utility.Vector2iVector(ends)
            )
            lines.colors = o3d.utility.Vector3dVector(parts.line_colors)
            scene.add_geometry("lines", lines, _material("unlitLine", line_width=2.0))
        if parts.mesh is not None:
            mesh = o3d.io.read_triangle_mesh(str(parts.mesh))
            mesh.compute_vertex_normals()
            # shading in the colours: a lit material takes seconds a picture on a software driver
            normals = np.asarray(mesh.vertex_normals)
            shade = 0.25 + 0.75 * np.abs(normals @ (np.array([0.4, 0.5, 0.77])))
            mesh.vertex_colors = o3d.utility.Vector3dVector(shade[:, None] * (np.array(SECOND) / 255))
            scene.add_geometry("mesh", mesh, _material("defaultUnlit"))
        self.reset()
        return True

    def reset(self) -> None:
        """Back to the first view."""
        if self._parts is None:
            return
        home = self._parts.home
        self.widget.setup_camera(_FIELD, self.widget.scene.bounding_box, home.target.astype(np.float32))
        self.widget.look_at(
            home.target.astype(np.float32), home.eye.astype(np.float32), np.asarray(home.up, np.float32)
        )


def _material(shader: str, point_size: float = 3.0, line_width: float = 1.0) -> rendering.MaterialRecord:
    material = rendering.MaterialRecord()
    material.shader = shader
    material.point_size, material.line_width = point_size, line_width
    return material
