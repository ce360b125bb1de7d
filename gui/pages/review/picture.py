"""Draws an edited frame: kept splats, removed and selected ones in colors, the crop box, the ground and the world."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import torch

from v3studio.gui.drawing import compare
from v3studio.gui.drawing.canvas import Canvas, wrapped
from v3studio.gui.drawing.palette import ACCENT, AXES, BAD, DIM, FAIR, GROUND, TEXT
from v3studio.gui.models.playback.viewpoint import BACKGROUNDS
from v3studio.gui.models.scene.compose import SplatLayer, Surfaces, compose, draw_layer
from v3studio.gui.models.scene.contents import Color, Lines, axis_lines, box_lines, grid_lines
from v3studio.gui.models.scene.fragments import line_fragments, point_fragments
from v3studio.gui.models.scene.handles import Handle
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.pages.review.editor import Measured
from v3studio.gui.pages.review.frame import EditedFrame
from v3studio.gui.pages.review.handles import detail_lines, tool_handles
from v3studio.gui.pages.review.histogram import HistogramPlace, draw_histogram
from v3studio.gui.pages.review.tools import PLACES, Stroke, Tool, hint
from v3studio.gui.pages.stage_view import Size
from v3studio.studio.cameras import Camera
from v3studio.studio.counts import counted
from v3studio.studio.edits.edit_list import EditList
from v3studio.studio.gaussians import SH_C0, Gaussians

MANY = 3000  # selected splats from which on their dots are small


@dataclass(frozen=True)
class Shown:
    """Everything that the image of an edited frame depends on, besides its size."""

    frame: int
    view: tuple[float, ...]
    orbit: OrbitCamera = field(compare=False)  # with `view` as its key
    tool: Tool
    show_removed: bool
    edits: EditList
    pending: EditList | None
    stroke: Stroke | None
    clicks: tuple[tuple[float, ...], ...]
    held: str
    up: tuple[float, ...]
    background: str
    trained: int
    em: float


def draw_edits(edited: EditedFrame, shown: Shown, size: Size) -> tuple[np.ndarray, Measured]:
    """The image (height, width, 3) uint8 of a frame that was read, and what it has shown about the splats."""
    selection = edited.selection(shown.edits)
    removed = selection.removed
    selected = back = np.zeros_like(removed)
    proposed = None
    if shown.pending is not None:
        pending = edited.selection(shown.pending).removed
        selected, back = pending & ~removed, removed & ~pending
    elif shown.tool == Tool.FLOATERS:
        proposed = edited.proposed_floaters(shown.edits)
    measured = Measured(edited.seen(removed), int(removed.sum()), int(selected.sum()), int(back.sum()), proposed)
    view = shown.orbit.camera(*size)
    splats = draw_layer(_colored(edited.gaussians, removed, selected, shown.show_removed), view)
    canvas = _scene(edited, view, shown, splats, selected, measured.seen)
    if shown.tool == Tool.FLOATERS:
        limits = (shown.pending or shown.edits).floaters
        kept = ~np.any([selection.kinds[name] for name in ("crop", "ground", "regions")], axis=0)
        opacities, limit = edited.paths.opacities.max(axis=0)[kept], limits.opacity if limits is not None else None
        draw_histogram(canvas, HistogramPlace(size, shown.em), opacities, limit)
    _write_words(canvas, edited, shown, measured)
    return canvas.pixels, measured


def _write_words(canvas: Canvas, edited: EditedFrame, shown: Shown, measured: Measured) -> None:
    """Write what is kept, and what to do next."""
    em, size = shown.em, round(0.9 * shown.em)
    trim, total = shown.edits.trim, len(edited.gaussians)
    number = edited.paths.frames[edited.at]
    outside = "   trimmed off" if trim is not None and not trim.holds(number) else ""
    kept = total - measured.removed
    words = f"group {edited.group.index}: {kept:,} of {counted(total, 'splat')} kept{outside}"
    compare.label(canvas, 0.6 * em, 0.6 * em, words, size=size)
    pending, selected, back = shown.pending, measured.selected, measured.back
    floaters = pending.floaters if pending is not None else None
    in_use = floaters is not None and floaters == shown.edits.floaters
    words = hint(shown.tool, None if pending is None else selected, back, floaters, in_use)
    color = FAIR if pending is not None and selected + back else TEXT
    lines = wrapped(words, size, canvas.width - 2 * em) if words else []
    for row, line in enumerate(lines):
        compare.label(canvas, 0.6 * em, (2.5 + 1.6 * row) * em, line, color=color, size=size)


def _scene(
    edited: EditedFrame, view: Camera, shown: Shown, splats: SplatLayer, selected: np.ndarray, seen: np.ndarray
) -> Canvas:
    """The splats with the box, the plane, the details, the world's axes and what the tool draws."""
    edits, number = shown.pending or shown.edits, edited.paths.frames[edited.at]
    points = seen if len(seen) else np.zeros((1, 3))
    middle, reach = np.median(points, axis=0), float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
    colors = {shown.tool: ACCENT}  # by tool: what it changes looks chosen
    among = []
    if edits.ground is not None:
        grid, _ = grid_lines(middle, edits.ground.unit, edits.ground.height, 0.6 * reach)
        among.append(Lines.of(grid.ends, colors.get(Tool.GROUND, DIM)))
    if edits.crop is not None:
        among.append(box_lines(edits.crop.corners, colors.get(Tool.CROP, DIM), 2.0 if shown.tool == Tool.CROP else 1.0))
    over = [detail_lines(mark, number, view.center, colors.get(Tool.DETAIL, DIM)) for mark in edits.details]
    over.append(Lines.of(np.array(list(pairwise(shown.clicks))), FAIR, 2.0))
    back = edits.similarity.inverse
    axes = axis_lines(back.points(np.zeros(3)), back.directions(np.eye(3)), 0.25 * reach)
    shows_axes = edits.world is not None or shown.tool in PLACES
    over += [axes] if shows_axes else []
    dots = edited.paths.means[edited.at][selected]
    canvas = _composed(view, splats, BACKGROUNDS[shown.background], among, over, dots)
    if shows_axes:
        _draw_names(canvas, view, axes)
    for x, y in _seen(view, *shown.clicks):
        canvas.dot(x, y, 6, FAIR)
    handles = tool_handles(shown.tool, edits, view, seen, number, np.array(shown.up))
    _draw_handles(canvas, view, handles, shown.held)
    if shown.stroke is not None:
        _draw_stroke(canvas, shown.stroke)
    return canvas


def _colored(gaussians: Gaussians, removed: np.ndarray, selected: np.ndarray, show_removed: bool) -> Gaussians:
    """The splats to draw: selected ones and, if `show_removed`, removed ones in colors of their own."""
    sh = gaussians.sh.clone()
    for mask, color in ((removed, BAD), (selected & ~removed, FAIR)):
        chosen = torch.from_numpy(mask)
        sh[chosen] = 0
        sh[chosen, 0] = (torch.tensor(color, dtype=sh.dtype) / 255 - 0.5) / SH_C0
    painted = replace(gaussians, sh=sh)
    return painted if show_removed else painted[torch.from_numpy(~removed)]


def _composed(
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
    inside: list[list[float]] = pixels[(depth > 0) & (np.abs(pixels) < 1e5).all(axis=1)].tolist()
    return inside


def _draw_handles(canvas: Canvas, view: Camera, handles: Sequence[Handle], held: str) -> None:
    """Draw a dot for each handle; the one that is held is larger."""
    for handle in handles:
        for x, y in _seen(view, handle.place):
            canvas.dot(x, y, 8.5 if handle.name == held else 7.0, TEXT)
            canvas.dot(x, y, 5.5, ACCENT)


def _draw_names(canvas: Canvas, view: Camera, axes: Lines) -> None:
    """Write the names of three axes at their ends."""
    for name, color, (_, end) in zip("xyz", AXES, axes.ends, strict=True):
        for x, y in _seen(view, end):
            canvas.text(x + 5, y - 8, name, 15, color)


def with_circle(pixels: np.ndarray, x: float, y: float, radius: float) -> np.ndarray:
    """A copy of an image with the outline of the brush, bright on dark so that it is seen on everything."""
    canvas = Canvas.of(pixels.copy())
    canvas.dot(x, y, radius + 1, GROUND, filled=False)
    canvas.dot(x, y, radius, TEXT, filled=False)
    return canvas.pixels


def _draw_stroke(canvas: Canvas, stroke: Stroke) -> None:
    """Draw a lasso's outline, or the path of a brush as wide as it is."""
    if stroke.radius is None:
        canvas.line([*stroke.points, stroke.points[0]], FAIR, 2)
        return
    below = canvas.pixels.copy()
    for x, y in stroke.points[:1]:
        canvas.dot(x, y, stroke.radius, FAIR)
    canvas.line(list(stroke.points), FAIR, max(round(2 * stroke.radius), 1))
    canvas.pixels[:] = (0.55 * below + 0.45 * canvas.pixels).astype(np.uint8)
