"""Line plots on a canvas."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gui.drawing.canvas import Canvas, text_width
from gui.drawing.palette import DIM, LINE, PANEL, RGB, SERIES, TEXT


def ticks(low: float, high: float, count: int = 4) -> list[float]:
    """About `count` round numbers from low to high."""
    span = high - low
    if span <= 0 or not math.isfinite(span):
        return [low]
    rough = span / max(count, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= rough)
    first = math.ceil(low / step)
    return [number * step for number in range(first, int(high / step + 1e-9) + 1)]


def number(value: float) -> str:
    """Format a number for an axis: 12,000 or 0.05."""
    if value == int(value):
        return f"{int(value):,}"
    return f"{value:.4g}"


def curve(
    canvas: Canvas,
    area: tuple[float, float, float, float],
    title: str,
    series: Sequence[tuple[Sequence[float], Sequence[float]]],
    color: RGB,
    em: float,
    x_limits: tuple[float, float] = (0.0, 1.0),
    x_words: tuple[str, str] = ("", ""),
    newest: str = "",
    nothing: str = "no data from the last run",
) -> None:
    """Draw a line plot: title and latest value above, ticks at the left.

    Args:
        area: x, y, width, height in the canvas.
        series: positions and values of each line.
        color: of the value above, and of a single line; several have those of `SERIES` (`legend` names them).
        x_words: labels below the left and right ends of the axis.
        newest: the latest value.
        nothing: shown instead of lines where there are none.
    """
    x, y, width, height = area
    size = round(0.82 * em)
    canvas.text(x, y, title, round(0.95 * em), TEXT)
    canvas.text(x + width, y, newest, round(0.95 * em), color, align="right")
    left, top = x + 3.6 * em, y + 1.6 * em
    wide, high = width - 3.6 * em, height - 1.6 * em - 1.5 * size
    canvas.rect(left, top, wide, high, PANEL)
    lines = [
        np.array([(a, b) for a, b in zip(xs, ys, strict=True) if math.isfinite(a) and math.isfinite(b)])
        for xs, ys in series
    ]
    several = len(lines) > 1
    colors = [SERIES[index % len(SERIES)] if several else color for index in range(len(lines))]
    drawn = [(line, one) for line, one in zip(lines, colors, strict=True) if len(line)]
    lines = [line for line, _ in drawn]
    canvas.text(left, top + high + 3, x_words[0], size, DIM)
    canvas.text(left + wide, top + high + 3, x_words[1], size, DIM, align="right")
    if not lines:
        canvas.text(left + wide / 2, top + high / 2 - size / 2, nothing, size, DIM, align="middle")
        return
    points = np.concatenate(lines)
    low, high_value = float(points[:, 1].min()), float(points[:, 1].max())
    pad = 0.06 * (high_value - low) or 0.05 * abs(high_value) or 1.0
    low, high_value = low - pad, high_value + pad
    for tick in ticks(low, high_value):
        row = top + high * (1 - (tick - low) / (high_value - low))
        canvas.rect(left, row, wide, 1, LINE)
        canvas.text(left - 6, row - 0.62 * size, number(tick), size, DIM, align="right")
    span = max(x_limits[1] - x_limits[0], 1e-12)
    for line, own in drawn:
        across = left + wide * (line[:, 0] - x_limits[0]) / span
        down = top + high * (1 - (line[:, 1] - low) / (high_value - low))
        canvas.line(np.column_stack([across, down]), own, 2)
        canvas.dot(across[-1], down[-1], 3, own)


def legend(canvas: Canvas, x: float, y: float, width: float, size: int, title: str, names: Sequence[str]) -> None:
    """Draw a title and names with dots in the colors of several lines of `curve`, as many as there is room for; an
    ellipsis stands for the rest.

    Args:
        x, y: upper left corner.
        width: room, pixels.
        size: of the text, pixels.
    """
    used = canvas.text(x, y, title, size, DIM, width=width) + 0.8 * size
    for number, name in enumerate(names):
        wide = text_width(name, size) + 1.7 * size
        if used + wide + (size if number + 1 < len(names) else 0) > width:
            canvas.text(x + used, y, "…", size, DIM)
            return
        canvas.dot(x + used + 0.3 * size, y + 0.62 * size, 0.28 * size, SERIES[number % len(SERIES)])
        canvas.text(x + used + 0.8 * size, y, name, size, TEXT)
        used += wide
