"""The scene drawn by Open3D: splats, frusta, mesh, points and guides in one depth buffer.

The splats of each frame replace those of the last one. Pictures that are compared or measured are never drawn here.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from pathlib import Path

import numpy as np
import open3d as o3d
from open3d.visualization import gui, rendering

from gui.drawing.painter import frustum
from gui.models.playback.player import PlayerPresenter
from gui.models.playback.viewpoint import BACKGROUNDS
from gui.models.scene.contents import SceneContents
from gui.models.scene.native import NativeScene, encoded, splat_arrays, tiled
from gui.models.scene.render import frusta_lines
from gui.widgets.raycast import MeshPicture
from studio.errors import StudioError
from studio.gaussians import Gaussians

POINT_SIZE = 3.0
"""Of sparse points, pixels."""

ENCODED = np.round(255 * encoded(np.arange(256) / 255)).astype(np.uint8)
"""Textures and backgrounds are shown in linear light as if that were sRGB, so they are encoded twice."""

SHADERS = Path(o3d.__file__).parent / "resources" / "gaussian_splat"

Drawn = tuple[o3d.t.geometry.Geometry, rendering.MaterialRecord]


class SceneView:
    """See the module. Nothing is made before the scene is first drawn.

    Args:
        window: where it is shown.
        on_mouse: receives events with the position in the view (x, y, pixels). Open3D's own controls are not used, so
            that the view moves as everywhere else and looks through cameras.
        covered: tells whether something lies over the view at a position in the window, pixels.

    Attributes:
        latest: the scene that was shown last; None while it is hidden.
    """

    def __init__(
        self,
        window: gui.Window,
        on_mouse: Callable[[gui.MouseEvent, float, float], bool],
        covered: Callable[[int, int], bool],
    ) -> None:
        self._window, self._on_mouse, self._covered = window, on_mouse, covered
        self._widget: gui.SceneWidget | None = None
        self._frame: tuple[int, int, int, int] = (0, 0, 16, 16)
        self.latest: NativeScene | None = None
        self._scene: NativeScene | None = None
        self._shown: dict[str, tuple[Hashable, list[str]]] = {}
        self._count = 0
        self._background = ""
        self._view: Hashable = None

    # Where and whether it is shown

    def place(self, x: int, y: int, width: int, height: int) -> None:
        """Set the rectangle in window pixels."""
        self._frame = (x, y, max(width, 16), max(height, 16))
        if self._widget is not None:
            self._widget.frame = gui.Rect(*self._frame)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self._frame[2:]

    @property
    def shown(self) -> bool:
        """Whether it is on screen."""
        return self._widget is not None and bool(self._widget.visible)

    def drawn(self, scene: NativeScene | None) -> bool:
        """Whether Open3D has been given this scene."""
        return scene is not None and scene is self._scene

    @property
    def words(self) -> str:
        """What is shown, in words."""
        return self._scene.contents.words if self._scene is not None else ""

    def hide(self) -> bool:
        """Hide it and drop what it shows; returns whether that is a change."""
        if self._widget is None or not self._widget.visible:
            return False
        self._widget.visible = False
        self._widget.scene.clear_geometry()
        self._shown, self._scene, self.latest, self._view = {}, None, None, None
        return True

    def show(self, scene: NativeScene) -> None:
        """Show a scene from the next `draw` on.

        Raises:
            StudioError: `gui.no_open3d_scene`, if Open3D cannot draw splats.
        """
        if self._widget is None:
            self._widget = self._make()
        self.latest = scene
        self._widget.visible = True

    def _make(self) -> gui.SceneWidget:
        if not any(SHADERS.glob("*")):  # Open3D would draw no splats and only log that
            raise StudioError("gui.no_open3d_scene", "this Open3D has no shaders for splats", file=SHADERS)
        widget = gui.SceneWidget()
        widget.scene = rendering.Open3DScene(self._window.renderer)
        widget.enable_scene_caching(True)
        widget.scene.view.set_post_processing(False)
        widget.set_on_mouse(self._mouse)
        widget.frame = gui.Rect(*self._frame)
        # only now: a widget without a scene ends the process with a native crash, and one within another widget is
        # covered by the background of that as soon as it is clicked
        self._window.add_child(widget)
        return widget

    def _mouse(self, event: gui.MouseEvent) -> gui.Widget.EventCallbackResult:
        if self._covered(event.x, event.y):
            return gui.Widget.EventCallbackResult.IGNORED
        self._on_mouse(event, event.x - self._frame[0], event.y - self._frame[1])
        return gui.Widget.EventCallbackResult.CONSUMED

    # What is drawn

    def draw(self, background: str, eye: np.ndarray) -> None:
        """Hand what is shown to Open3D. Call before the window is drawn.

        Args:
            background: a key of `BACKGROUNDS`.
            eye: (3,) position of the viewer, world coordinates.

        Raises:
            StudioError: `gui.no_open3d_scene`, if Open3D refuses it.
        """
        if self._widget is None or not self.shown or self.latest is None:
            return
        if background != self._background:
            self._background = background
            self._widget.scene.set_background([*encoded(np.array(BACKGROUNDS[background])).tolist(), 1.0])
            self._widget.force_redraw()
        before, self._scene = self._scene, self.latest  # `before` lives on, so that ids stay unique
        splats, contents = self.latest.gaussians, self.latest.contents.seen_from(eye)
        self._swap("splats", id(splats), lambda: [_splats(splats)] if splats is not None else [])
        lines = [*contents.lines, frusta_lines(contents)]
        self._swap(
            "lines",
            tuple((one.ends.tobytes(), one.colors.tobytes(), one.width) for one in lines),
            lambda: [_lines(one.ends, one.colors, one.width) for one in lines if len(one.ends)],
        )
        points = contents.points
        self._swap(
            "points", (id(points), len(points)), lambda: [_points(points, contents.colors)] if len(points) else []
        )
        mesh = contents.mesh
        self._swap("mesh", id(mesh), lambda: [_mesh(mesh)] if isinstance(mesh, MeshPicture) else [])
        images = [(one.camera.name, id(one.image)) for one in contents.cameras]
        self._swap("images", (tuple(images), contents.length), lambda: _images(contents))
        del before

    def _swap(self, part: str, key: Hashable, make: Callable[[], list[Drawn]]) -> None:
        """Show other geometry for a part, if its key has changed."""
        assert self._widget is not None
        scene = self._widget.scene
        before = self._shown.get(part, (None, []))
        if part in self._shown and before[0] == key:
            return
        names = []
        try:
            for geometry, material in make():
                self._count += 1
                names.append(f"{part} {self._count}")
                scene.add_geometry(names[-1], geometry, material, False)
                if not scene.has_geometry(names[-1]):
                    raise StudioError("gui.no_open3d_scene", f"Open3D does not take the {part} of the scene")
        except RuntimeError as error:
            raise StudioError("gui.no_open3d_scene", f"Open3D does not take the {part} of the scene: {error}") from None
        for name in before[1]:
            scene.remove_geometry(name)
        self._shown[part] = (key, names)
        self._widget.force_redraw()

    # The camera

    def follow(self, player: PlayerPresenter) -> bool:
        """Show the player's view; returns whether it has changed."""
        widget = self._widget
        if widget is None or self._scene is None or not self.shown:
            return False
        key = (player.orbit.key, player.camera, player.image_zoom, self.size)
        view = player.view(self.size) if key != self._view else None
        if view is None:
            return False
        box = widget.scene.bounding_box
        box = box.scale(3.0, box.get_center())  # the far plane lies behind what is shown later, too
        widget.setup_camera(view.K, view.world_to_camera, view.width, view.height, box)
        widget.force_redraw()
        self._view = key
        return True


def _material(shader: str) -> rendering.MaterialRecord:
    found = rendering.MaterialRecord()
    found.shader = shader
    return found


def _tensor(array: np.ndarray, kind: type = np.float32) -> o3d.core.Tensor:
    return o3d.core.Tensor(np.ascontiguousarray(array.astype(kind)))


def _splats(gaussians: Gaussians) -> Drawn:
    arrays = splat_arrays(gaussians)
    cloud = o3d.t.geometry.PointCloud()
    for name, values in arrays.items():
        cloud.point[name] = _tensor(values)
    material = _material("gaussianSplat")
    material.gaussian_splat_sh_degree = min(gaussians.sh_degree, 2)
    return cloud, material


def _lines(ends: np.ndarray, colors: np.ndarray, width: float) -> Drawn:
    count = len(ends)
    lines = o3d.t.geometry.LineSet(_tensor(ends.reshape(-1, 3)), _tensor(np.arange(2 * count).reshape(-1, 2), np.int32))
    lines.line.colors = _tensor(colors / 255)
    material = _material("unlitLine")
    material.line_width = width
    return lines, material


def _points(points: np.ndarray, colors: np.ndarray) -> Drawn:
    cloud = o3d.t.geometry.PointCloud(_tensor(points))
    cloud.point.colors = _tensor(colors / 255)
    material = _material("defaultUnlit")
    material.point_size = POINT_SIZE
    return cloud, material


def _mesh(mesh: MeshPicture) -> Drawn:
    return mesh.shaded(), _material("defaultUnlit")


def _images(contents: SceneContents) -> list[Drawn]:
    """The cameras' images on their frusta, as one mesh with one texture."""
    found = [(one.camera, one.image) for one in contents.cameras if one.image is not None]
    if not found:
        return []
    texture, corners = tiled([image for _, image in found])
    places = np.concatenate([frustum(camera, contents.length)[1] for camera, _ in found])
    own = np.array([(0, 1, 2), (0, 2, 3), (2, 1, 0), (3, 2, 0)])  # seen from both sides
    triangles = (own[None] + 4 * np.arange(len(found))[:, None, None]).reshape(-1, 3)
    mesh = o3d.t.geometry.TriangleMesh(_tensor(places), _tensor(triangles, np.int32))
    mesh.triangle.texture_uvs = _tensor(np.array([0, 1]) + np.array([1, -1]) * corners.reshape(-1, 2)[triangles])
    material = _material("defaultUnlit")
    material.albedo_img = o3d.geometry.Image(ENCODED[texture])
    return [(mesh, material)]
