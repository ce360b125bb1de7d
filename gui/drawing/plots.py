"""Axes and line plots on a canvas."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from v3studio.gui.drawing.canvas import Canvas, text_width
from v3studio.gui.drawing.palette import DIM, LINE, PANEL, SECOND, SERIES, TEXT


def ticks(low: float, high: float, count: int = 4) -> list[float]:
    """About `count` round numbers from low to high."""
    span = high - low
    if span <= 0 or not math.isfinite(span):
        return [low]
    step = round_step(span / max(count, 1))
    first = math.ceil(low / step)
    return [number * step for number in range(first, int(high / step + 1e-9) + 1)]


def round_step(least: float) -> float:
    """The lowest of 1, 2 and 5 times a power of ten that is not below a number above 0."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= least * (1 - 1e-9))


def number(value: float) -> str:
    """Format a number for an axis: 12,000 or 0.05."""
    if value == int(value):
        return f"{int(value):,}"
    return f"{value:.4g}"


@dataclass(frozen=True)
class Axes:
    """The area of a plot, and how values become places in it: their limits at its left and right, bottom and top."""

    left: float
    top: float
    width: float
    height: float
    x_limits: tuple[float, float]
    y_limits: tuple[float, float]

    def places(self, xs: Sequence[float] | np.ndarray, ys: Sequence[float] | np.ndarray) -> np.ndarray:
        """(N, 2) pixels of N points."""
        (left, right), (low, high) = self.x_limits, self.y_limits
        across = (np.asarray(xs, float) - left) / max(right - left, 1e-12)
        up = (np.asarray(ys, float) - low) / max(high - low, 1e-12)
        return np.column_stack([self.left + self.width * across, self.top + self.height * (1 - up)])

    def draw(self, canvas: Canvas, size: int, columns: bool = False) -> None:
        """Draw the area, and a line with its number at each tick of the y axis; with `columns`, also of the x axis.
        `size` is that of the numbers, pixels."""
        canvas.rect(self.left, self.top, self.width, self.height, PANEL)
        for tick in ticks(*self.y_limits):
            row = self.places([self.x_limits[0]], [tick])[0, 1]
            canvas.rect(self.left, row, self.width, 1, LINE)
            canvas.text(self.left - 6, row - 0.62 * size, number(tick), size, DIM, align="right")
        for tick in ticks(*self.x_limits) if columns else ():
            column = self.places([tick], [self.y_limits[0]])[0, 0]
            canvas.rect(column, self.top, 1, self.height, LINE)
            canvas.text(column, self.top + self.height + 4, number(tick), size, DIM, align="middle")


def limits(values: np.ndarray, share: float, least: float = 0.0) -> tuple[float, float]:
    """Limits around values, with a share of their range free on each side, at least `least`."""
    low, high = float(values.min()), float(values.max())
    pad = max(share * (high - low), least) or 0.05 * abs(high) or 1.0
    return low - pad, high + pad


def curve(
    canvas: Canvas,
    area: tuple[float, float, float, float],
    title: str,
    series: Sequence[tuple[Sequence[float], Sequence[float]]],
    em: float,
    newest: str,
    nothing: str,
) -> None:
    """Draw lines over the course of a run, 0 to 1, in x, y, width, height of the canvas: title and newest value above,
    ticks at the left. Several have the colors of `SERIES` (`legend` names them). `nothing`: said instead of none."""
    x, y, width, height = area
    size = round(0.82 * em)
    canvas.text(x, y, title, round(0.95 * em), TEXT)
    canvas.text(x + width, y, newest, round(0.95 * em), SECOND, align="right")
    left, top = x + 3.6 * em, y + 1.6 * em
    wide, high = width - 3.6 * em, height - 1.6 * em - 1.5 * size
    lines = [
        np.array([(a, b) for a, b in zip(xs, ys, strict=True) if math.isfinite(a) and math.isfinite(b)])
        for xs, ys in series
    ]
    drawn = [(line, SERIES[index % len(SERIES)]) for index, line in enumerate(lines) if len(line)]
    canvas.text(left, top + high + 3, "0%", size, DIM)
    canvas.text(left + wide, top + high + 3, "100%", size, DIM, align="right")
    if not drawn:
        canvas.rect(left, top, wide, high, PANEL)
        canvas.text(left + wide / 2, top + high / 2 - size / 2, nothing, size, DIM, align="middle")
        return
    axes = Axes(left, top, wide, high, (0.0, 1.0), limits(np.concatenate([line for line, _ in drawn])[:, 1], 0.06))
    axes.draw(canvas, size)
    for line, own in drawn:
        places = axes.places(line[:, 0], line[:, 1])
        canvas.line(places, own, 2)
        x, y = places[-1]
        canvas.dot(x, y, 3, own)


def legend(canvas: Canvas, x: float, y: float, width: float, size: int, title: str, names: Sequence[str]) -> None:
    """Draw a title and names with dots in the colors of several lines of `curve`; an ellipsis if not all fit."""
    used = canvas.text(x, y, title, size, DIM, width=width) + 0.8 * size
    for number, name in enumerate(names):
        wide = text_width(name, size) + 1.7 * size
        if used + wide + (size if number + 1 < len(names) else 0) > width:
            canvas.text(x + used, y, "…", size, DIM)
            return
        canvas.dot(x + used + 0.3 * size, y + 0.62 * size, 0.28 * size, SERIES[number % len(SERIES)])
        canvas.text(x + used + 0.8 * size, y, name, size, TEXT)
        used += wide
