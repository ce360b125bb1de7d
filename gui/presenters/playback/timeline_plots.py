"""The plots above the timeline: PSNR trained, PSNR decoded, KB per frame, and the waveform of the sound."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gui.presenters.drawing.canvas import Canvas, text_width
from gui.presenters.drawing.palette import ACCENT, BAD, DIM, FAINT, LINE, PANEL, RAISED, RGB, SECOND, TEXT
from gui.presenters.playback.timeline import Timeline

MARK_HEIGHT = 7
GAP = 3


@dataclass(frozen=True)
class Plot:
    """One row.

    Attributes:
        title: shown to its left.
        values: one per frame; None if not measured.
        color: color of the curve.
        unit: shown after the numbers.
    """

    title: str
    values: Sequence[float | None]
    color: RGB
    unit: str

    @property
    def range(self) -> tuple[float, float] | None:
        """Lowest and highest value; None if there are none."""
        known = [value for value in self.values if value is not None]
        return (min(known), max(known)) if known else None


@dataclass(frozen=True, eq=False)
class Waveform(Plot):
    """The sound: a row without values.

    Attributes:
        peaks: (N, 2) lowest and highest sample, -1 to 1, of N equal parts of the frames' duration.
    """

    peaks: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.float32))

    def columns(self, width: int) -> np.ndarray:
        """(width, 2) lowest and highest sample under each column."""
        edges = np.linspace(0, len(self.peaks), width + 1)
        first = np.minimum(edges[:-1].astype(int), len(self.peaks) - 1)
        end = np.maximum(np.ceil(edges[1:]).astype(int), first + 1)
        low = [self.peaks[a:b, 0].min() for a, b in zip(first, end, strict=True)]
        high = [self.peaks[a:b, 1].max() for a, b in zip(first, end, strict=True)]
        return np.column_stack([low, high])


def plots_of(evaluation_series: dict[str, list[float | None]], mean: str = "mean") -> tuple[Plot, ...]:
    """The three plots of a take; plots without values stay empty, so that the layout does not change.

    Args:
        evaluation_series: values by metric.
        mean: which cameras PSNR is averaged over, for the title.
    """
    kilobytes = [None if value is None else value / 1000 for value in evaluation_series.get("bytes", [])]
    return (
        Plot(f"PSNR trained, {mean}", evaluation_series.get("psnr_trained", []), SECOND, "dB"),
        Plot(f"PSNR decoded, {mean}", evaluation_series.get("psnr_decoded", []), ACCENT, "dB"),
        Plot("KB per frame, group mean", kilobytes, SECOND, "KB"),
    )


@dataclass(frozen=True)
class TimelinePlots:
    """Plots above the track, on the same frame axis; clicking any of them seeks.

    Attributes:
        width, height: pixels.
        em: font size, pixels.
        frame_count, group_starts: as in `Timeline`.
    """

    width: int
    height: int
    em: float
    frame_count: int
    group_starts: Sequence[int] = (0,)

    @property
    def left(self) -> int:
        """Column where frame 0 begins; the titles are to the left of it."""
        return min(round(16.5 * self.em), self.width // 3)

    @property
    def track_height(self) -> int:
        """Height of the timeline's track at the bottom, in pixels."""
        return max(round(1.5 * self.em), 10)

    @property
    def timeline(self) -> Timeline:
        """Mapping of columns, counted from `left`, to frames."""
        return Timeline(max(self.width - self.left, 1), self.track_height, self.frame_count, self.group_starts)

    def frame_at(self, x: float) -> int:
        """The frame under a column of the picture."""
        return self.timeline.frame_at(x - self.left)

    def picture(self, frame: int | None, plots: Sequence[Plot], marks: Iterable[int] = ()) -> np.ndarray:
        """(height, width, 3) uint8: plots, and the track with playhead and marks."""
        return self.with_head(self.base(plots, marks), frame, plots)

    def base(self, plots: Sequence[Plot], marks: Iterable[int] = ()) -> np.ndarray:
        """(height, width, 3) uint8: everything that does not depend on the frame. Cache it: playback draws it often."""
        canvas = Canvas(self.width, self.height, PANEL)
        timeline = self.timeline
        for number, plot in enumerate(plots):
            self._plot(canvas, timeline, plot, *self._rows(len(plots))[number])
        canvas.text(0, self._track + self.track_height / 2 - self._size(99) * 0.62, "Frame", self._size(99), DIM)
        for mark in marks:
            if mark < self.frame_count:
                middle = self.left + sum(timeline.span(mark)) / 2
                canvas.rect(middle - 2, self._track - GAP, 4, MARK_HEIGHT, BAD)
        return canvas.pixels

    def with_head(self, base: np.ndarray, frame: int | None, plots: Sequence[Plot]) -> np.ndarray:
        """A copy of `base` with the track, the playhead and the frame's values."""
        canvas = Canvas(1, 1)
        canvas.pixels = base.copy()
        timeline = self.timeline
        track = timeline.picture(frame)
        marks = base[self._track : self._track + MARK_HEIGHT, self.left :]
        canvas.image(self.left, self._track, track)
        shown = (marks == BAD).all(axis=2)
        canvas.pixels[self._track : self._track + MARK_HEIGHT, self.left :][shown] = BAD
        if frame is None:
            return canvas.pixels
        size = self._size(99)
        right = self.left - 8
        canvas.text(right, self._track + self.track_height / 2 - size * 0.62, str(frame), size, TEXT, align="right")
        for plot, (y, height) in zip(plots, self._rows(len(plots)), strict=True):
            value = plot.values[frame] if frame < len(plot.values) else None
            if value is None:
                continue
            size = self._size(height)
            words = f"{value:.2f} {plot.unit}"
            canvas.text(right, y + height / 2 - size * 0.62, words, size, TEXT, align="right")
            self._bar(canvas, timeline, plot, frame, value, y, height, plot.color)
        first, last = timeline.span(frame)
        head = self.left + (first + last - 1) // 2
        below = canvas.pixels[GAP : self._track - GAP, head].astype(np.float32)
        canvas.pixels[GAP : self._track - GAP, head] = (below * 0.4 + np.array(ACCENT) * 0.6).astype(np.uint8)
        return canvas.pixels

    @property
    def _track(self) -> int:
        return self.height - self.track_height

    def _rows(self, count: int) -> list[tuple[int, int]]:
        """(top, height) of each plot."""
        each = (self._track - GAP) // max(count, 1) - GAP
        return [(GAP + number * (each + GAP), each) for number in range(count)]

    def _size(self, height: int) -> int:
        return max(min(round(0.78 * self.em), height - 1), 8)

    def _bar(
        self,
        canvas: Canvas,
        timeline: Timeline,
        plot: Plot,
        frame: int,
        value: float,
        y: int,
        height: int,
        color: RGB,
    ) -> None:
        limits = plot.range
        assert limits is not None
        low, high = limits
        pad = max(0.12 * (high - low), 1e-3 * max(abs(high), 1e-3))
        share = (value - low + pad) / (high - low + 2 * pad)
        bar = max(round(share * (height - 2)), 1)
        first, last = timeline.span(frame)
        canvas.rect(self.left + first, y + height - 1 - bar, max(last - first - (last - first > 3), 1), bar, color)

    def _plot(self, canvas: Canvas, timeline: Timeline, plot: Plot, y: int, height: int) -> None:
        size = self._size(height)
        room = self.left - 16 - text_width(f"00.00 {plot.unit}", size)
        canvas.text(0, y + height / 2 - size * 0.62, plot.title, size, DIM, width=room)
        canvas.rect(self.left, y, timeline.width, height, RAISED)
        for start in self.group_starts:
            if 0 < start < self.frame_count:
                canvas.rect(self.left + timeline.span(start)[0], y, 1, height, LINE)
        if isinstance(plot, Waveform):
            self._waveform(canvas, plot, y, height)
            return
        if plot.range is None:
            canvas.text(self.left + 8, y + height / 2 - size * 0.62, "not evaluated yet", size, FAINT)
            return
        for index, value in enumerate(plot.values[: self.frame_count]):
            if value is not None:
                self._bar(canvas, timeline, plot, index, value, y, height, _dimmed(plot.color))

    def _waveform(self, canvas: Canvas, plot: Waveform, y: int, height: int) -> None:
        if not len(plot.peaks):
            return
        middle, half = y + height / 2, (height - 2) / 2
        loudest = max(float(np.abs(plot.peaks).max()), 1e-3)  # fills the row, so that a quiet take is seen too
        for column, (low, high) in enumerate(plot.columns(self.timeline.width) / loudest):
            top, bottom = middle - high * half, middle - low * half
            canvas.rect(self.left + column, top, 1, max(bottom - top, 1), _dimmed(plot.color))


def _dimmed(color: RGB) -> RGB:
    return tuple(round(0.5 * one + 0.5 * other) for one, other in zip(color, RAISED, strict=True))  # type: ignore[return-value]
