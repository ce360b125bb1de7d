"""The scene's image, composed from the rasterizer's splats and everything else."""

import numpy as np

from v3studio.gui.drawing import compare
from v3studio.gui.drawing.canvas import Canvas
from v3studio.gui.drawing.labels import draw_labels
from v3studio.gui.drawing.palette import GROUND
from v3studio.gui.models.scene.compose import SplatLayer, Surfaces, compose, draw_layer
from v3studio.gui.models.scene.contents import Color, Lines, SceneContents, SceneRequest
from v3studio.gui.models.scene.fragments import NEAR, Patch, image_on_quad, line_fragments, point_fragments
from v3studio.gui.models.scene.gizmo import draw_gizmo
from v3studio.gui.models.scene.reader import SceneReader
from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians

Place = tuple[str, np.ndarray]

BACKGROUND: Color = (GROUND[0] / 255, GROUND[1] / 255, GROUND[2] / 255)
EDGES = np.array([(0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1)])  # between points of `frustum`


def render_scene(
    reader: SceneReader, gaussians: Gaussians, view: Camera, request: SceneRequest
) -> tuple[np.ndarray, tuple[Place, ...], tuple[Place, ...]]:
    """The scene's image, and name and pixels of frusta and axes, the front ones last. StudioError: a damaged file."""
    contents, em = reader.read(request).seen_from(view.center), request.em
    splats = draw_layer(gaussians, view) if "splats" in request.parts else None
    canvas = draw_contents(contents, view, splats, request.background)
    cameras, ends = frusta_places(contents, view), draw_gizmo(canvas, view, em)
    nearest = cameras[::-1]  # those in front choose first where their names are
    draw_labels(canvas, [name for name, _ in nearest], [corners for _, corners in nearest], round(0.8 * em))
    if contents.words:
        compare.label(canvas, 0.6 * em, 0.6 * em, contents.words, size=round(0.85 * em))
    return canvas.pixels, tuple(cameras), tuple(ends)


def draw_contents(
    contents: SceneContents, view: Camera, splats: SplatLayer | None = None, background: Color = BACKGROUND
) -> Canvas:
    """The image of the contents, and of splats among them if they are given."""
    surfaces = Surfaces(view.width, view.height)
    for surface, place in contents.surfaces:
        pixels, depth = surface.seen(place.inverse.camera(view))
        surfaces.add(Patch(slice(None), slice(None), np.isfinite(depth), pixels, depth * place.scale))
    for shown in contents.cameras:
        if shown.image is not None:
            surfaces.add(image_on_quad(view, frustum(shown.camera, contents.length)[1:], shown.image))
    parts = [line_fragments(view, lines) for lines in (*contents.lines, frusta_lines(contents))]
    parts += [point_fragments(view, *points) for points in contents.points]
    return Canvas.of(compose(background, splats, surfaces, np.concatenate(parts)))


def frustum(camera: Camera, length: float) -> np.ndarray:
    """(5, 3): the optical center and the image's corners at a distance, in world coordinates."""
    image = np.array([[0, 0], [camera.width, 0], [camera.width, camera.height], [0, camera.height]], float)
    rays = np.column_stack([(image[:, 0] - camera.cx) / camera.fx, (image[:, 1] - camera.cy) / camera.fy, np.ones(4)])
    return np.vstack([camera.center, camera.center + (rays * length) @ camera.rotation])


def frusta_lines(contents: SceneContents) -> Lines:
    ends, colors = [], []
    for shown in contents.cameras:
        ends.append(frustum(shown.camera, contents.length)[EDGES])
        colors += [shown.color] * 8
    return Lines(np.array(ends, np.float64).reshape(-1, 2, 3), np.array(colors, np.uint8).reshape(-1, 3), 1.6)


def frusta_places(contents: SceneContents, view: Camera) -> list[tuple[str, np.ndarray]]:
    """Name and (5, 2) pixels of each camera's frustum, those in front last; without those partly behind the viewer."""
    places: list[tuple[float, str, np.ndarray]] = []
    for shown in contents.cameras:
        pixels, depth = view.project(frustum(shown.camera, contents.length))
        if (depth > NEAR).all():
            places.append((float(depth.mean()), shown.camera.name, pixels))
    return [(name, pixels) for _, name, pixels in sorted(places, key=lambda item: -item[0])]
