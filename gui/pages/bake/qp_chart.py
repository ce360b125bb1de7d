"""The chart of the QP trial: PSNR over size, one point per QP, the levels of quality, and a table beside it."""

import numpy as np

from v3studio.gui.drawing.canvas import Canvas, line_height
from v3studio.gui.drawing.labels import draw_labels
from v3studio.gui.drawing.palette import ACCENT, DIM, RAISED, TEXT
from v3studio.gui.drawing.plots import Axes, limits
from v3studio.gui.models.stages import Trial
from v3studio.gui.pages.bake.qp_trial import QpTrial
from v3studio.gui.pages.stage_view import rectangle
from v3studio.studio.stream.settings import LEVELS

TABLE, TOP = 21.0, 5.2  # width of the table; height of what is above it; em
ENDS = (2.5, 8.5, 13.5, 19.0)  # where its columns end, em

Points = dict[int | str, tuple[float, float]]


def draw_trial(canvas: Canvas, em: float, trial: QpTrial, current: int | str, done: str) -> Points:
    """Draw it; returns the pixels of each QP and level. `current`: the quality set; `done`: what a click did."""
    wide, small = canvas.width, round(0.85 * em)
    canvas.text(em, 0.8 * em, trial.words, round(em), TEXT, width=wide - 2 * em)
    note = done or "Click a point or a level to set it, then run Bake. Lower QPs look better and take more bytes."
    canvas.text(em, 2.3 * em, note, small, ACCENT if done else DIM, width=wide - 2 * em)
    if wide > 2 * TABLE * em:  # else Ctrl+C copies it
        wide -= round(TABLE * em)
        _draw_table(canvas, wide, em, trial.cells, str(current))
    return _draw_curve(canvas, wide - 2 * em, em, dict(sorted(trial.results.items())), current)


def _draw_table(canvas: Canvas, x: float, em: float, cells: list[list[str]], current: str) -> None:
    y, step = TOP * em, 1.25 * line_height(round(em))
    for number, row in enumerate(cells):
        if row[0] == current:
            canvas.rect(x, y - 0.2 * em, 20 * em, step, RAISED)
        for words, end in zip(row, ENDS, strict=True):
            canvas.text(x + end * em, y, words, round(em if number else 0.85 * em), TEXT if number else DIM, "right")
        y += step


def _draw_curve(canvas: Canvas, width: float, em: float, results: dict[int, Trial], current: int | str) -> Points:
    small, x, y = round(0.85 * em), em, TOP * em
    left, wide, high = x + 3.5 * em, width - 4.5 * em, canvas.height - y - 4 * em
    if wide < 6 * em or high < 4 * em:
        return {}
    canvas.text(x, y - 1.4 * em, "PSNR, dB", small, DIM)
    canvas.text(left + wide, y + high + 1.4 * em, "KB per frame", small, DIM, align="right")
    if not results:
        canvas.text(left + wide / 2, y + high / 2, "baking the first QP", small, DIM, align="middle")
        return {}
    sizes = np.array([result.bytes_per_frame / 1000 for result in results.values()])
    psnrs = np.array([result.psnr for result in results.values()])
    shown = np.append(psnrs, list(LEVELS.values()))
    axes = Axes(left, y, wide, high, (0.0, 1.1 * float(sizes.max())), limits(shown, 0.05, 0.5))
    axes.draw(canvas, small, columns=True)
    places = axes.places(sizes, psnrs)
    canvas.line(places, ACCENT, 2)
    points: Points = {}
    for level, psnr in LEVELS.items():
        row, color = float(axes.places([0.0], [psnr])[0, 1]), ACCENT if level == current else DIM
        canvas.rect(left, row, wide, 1, color)
        canvas.text(left + 0.4 * em, row - 1.4 * small, level, small, color)
        points[level] = (left + 2 * em, row - 0.7 * small)
    names, shapes, colors = [], [], []
    for qp, (across, down) in sorted(zip(results, places.tolist(), strict=True), key=lambda place: place[0] != current):
        points[qp], radius = (across, down), (0.42 if qp == current else 0.3) * em
        canvas.dot(across, down, radius, TEXT if qp == current else ACCENT)
        names.append(f"QP {qp}")
        shapes.append(rectangle(across - radius, down - radius, 2 * radius, 2 * radius))
        colors.append(TEXT if qp == current else DIM)
    draw_labels(canvas, names, shapes, small, colors)
    return points
