"""Draws an edited frame: kept splats, removed and selected ones in colors, the crop box, the ground and the world."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from v3studio.gui.drawing.canvas import Canvas
from v3studio.gui.drawing.palette import ACCENT, AXES, BAD, FAIR, GROUND, TEXT
from v3studio.gui.models.scene.compose import SplatLayer, Surfaces, compose
from v3studio.gui.models.scene.contents import Color, Lines
from v3studio.gui.models.scene.fragments import line_fragments, point_fragments
from v3studio.gui.models.scene.handles import Handle
from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import SH_C0, Gaussians

MANY = 3000  # selected splats from which on their dots are small


@dataclass(frozen=True)
class Stroke:
    """What is being drawn, in pixels of the image. `points`: (x, y). `radius`: of the brush; None: a lasso."""

    points: tuple[tuple[float, float], ...]
    radius: float | None


def colored(gaussians: Gaussians, removed: np.ndarray, selected: np.ndarray, show_removed: bool) -> Gaussians:
    """The splats to draw: selected ones and, if `show_removed`, removed ones in colors of their own."""
    sh = gaussians.sh.clone()
    for mask, color in ((removed, BAD), (selected & ~removed, FAIR)):
        chosen = torch.from_numpy(mask)
        sh[chosen] = 0
        sh[chosen, 0] = (torch.tensor(color, dtype=sh.dtype) / 255 - 0.5) / SH_C0
    found = replace(gaussians, sh=sh)
    return found if show_removed else found[torch.from_numpy(~removed)]


def composed(
    view: Camera, splats: SplatLayer, background: Color, among: Sequence[Lines], over: Sequence[Lines], dots: np.ndarray
) -> Canvas:
    """The splats before a background, lines `among` and `over` them, and dots at selected splats (N, 3): many are too
    faint, or behind others, to be seen."""
    colors = np.tile(np.array(FAIR, np.uint8), (len(dots), 1))
    nearest = [line_fragments(view, lines) for lines in over]
    nearest.append(point_fragments(view, dots.astype(np.float64), colors, 2 if len(dots) < MANY else 1))
    drawn = np.concatenate([*nearest, *(line_fragments(view, lines) for lines in among)])
    drawn["depth"][: sum(map(len, nearest))] *= 1e-6
    return Canvas.of(compose(background, splats, Surfaces(view.width, view.height), drawn))


def _seen(view: Camera, *points: Sequence[float] | np.ndarray) -> list[list[float]]:
    """Pixels of the points (3,) that are before the camera and not far beside the image."""
    pixels, depth = view.project(np.array(points, np.float64).reshape(-1, 3))
    found: list[list[float]] = pixels[(depth > 0) & (np.abs(pixels) < 1e5).all(axis=1)].tolist()
    return found


def draw_handles(canvas: Canvas, view: Camera, handles: Sequence[Handle], held: str) -> None:
    """Draw a dot for each handle; the one that is held is larger."""
    for handle in handles:
        for x, y in _seen(view, handle.place):
            canvas.dot(x, y, 8.5 if handle.name == held else 7.0, TEXT)
            canvas.dot(x, y, 5.5, ACCENT)


def draw_names(canvas: Canvas, view: Camera, axes: Lines) -> None:
    """Write the names of three axes at their ends."""
    for name, color, (_, end) in zip("xyz", AXES, axes.ends, strict=True):
        for x, y in _seen(view, end):
            canvas.text(x + 5, y - 8, name, 15, color)


def draw_clicks(canvas: Canvas, view: Camera, points: Sequence[tuple[float, ...]]) -> None:
    """Draw dots at picked points (3,)."""
    for x, y in _seen(view, *points):
        canvas.dot(x, y, 6, FAIR)


def with_circle(pixels: np.ndarray, x: float, y: float, radius: float) -> np.ndarray:
    """A copy of an image with the outline of the brush, bright on dark so that it is seen on everything."""
    canvas = Canvas.of(pixels.copy())
    canvas.dot(x, y, radius + 1, GROUND, filled=False)
    canvas.dot(x, y, radius, TEXT, filled=False)
    return canvas.pixels


def draw_stroke(canvas: Canvas, stroke: Stroke) -> None:
    """Draw a lasso's outline, or the path of a brush as wide as it is."""
    if stroke.radius is None:
        canvas.line([*stroke.points, stroke.points[0]], FAIR, 2)
        return
    below = canvas.pixels.copy()
    for x, y in stroke.points[:1]:
        canvas.dot(x, y, stroke.radius, FAIR)
    canvas.line(list(stroke.points), FAIR, max(round(2 * stroke.radius), 1))
    canvas.pixels[:] = (0.55 * below + 0.45 * canvas.pixels).astype(np.uint8)
