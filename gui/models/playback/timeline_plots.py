"""The plots above the timeline: quality, KB per frame, flicker, and the waveform of the sound."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from v3studio.gui.drawing.canvas import Canvas, text_width
from v3studio.gui.drawing.compare import What
from v3studio.gui.drawing.palette import ACCENT, BAD, DIM, FAIR, GROUND, LINE, PANEL, RAISED, RGB, SECOND, TEXT
from v3studio.gui.models.playback.timeline import WHOLE, Timeline, TimelineZoom
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers
from v3studio.studio.comparison.metrics import FLICKER, METRICS, Metric

_STEPS = [digit * 10**zeros for zeros in range(9) for digit in (1, 2, 5)]  # distances of numbered frames
LEAST_SPAN = 2.0  # least range of an axis that does not begin at zero, dB: smaller differences must not look large

MARK_HEIGHT = 7
KEY_SIZE = 0.4  # half of a diamond of the camera path, em

GAP = 3

RULER = 0.9  # height of the row of frame numbers above the track, em
APART = 3.5  # least room from one frame number to the next, em


@dataclass(frozen=True)
class Plot:
    """One row: bars that begin at zero, or a line on an axis with its own limits, and a line of the other values, of
    the bake or take that it is compared with, if any. `short`: the title where there is less room."""

    title: str
    values: Sequence[float | None]
    color: RGB
    unit: str
    bars: bool = False
    other: Sequence[float | None] = ()
    short: str = ""

    @property
    def extremes(self) -> tuple[float, float] | None:
        """The lowest value, of bars zero, and the highest; None if there are none."""
        known = [value for value in (*self.values, *self.other) if value is not None]
        return (0.0 if self.bars else min(known), max(known)) if known else None

    @property
    def range(self) -> tuple[float, float] | None:
        """Values at the lower and the upper end of the row; None if there are none."""
        if self.extremes is None:
            return None
        low, high = self.extremes
        if self.bars:
            return low, max(high, 1e-9) * 1.05
        pad = max(0.1 * (high - low), 0.5 * (LEAST_SPAN - (high - low)))
        return low - pad, high + pad


@dataclass(frozen=True, eq=False)
class Waveform(Plot):
    """The sound: a row without values. `peaks`: (N, 2) lowest and highest sample, -1 to 1, of N equal parts."""

    peaks: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.float32))

    def columns(self, width: int, start: float, end: float) -> np.ndarray:
        """(width, 2) lowest and highest sample under each column, of the part from `start` to `end`, 0 to 1."""
        edges = np.linspace(start * len(self.peaks), end * len(self.peaks), width + 1)
        first = np.minimum(edges[:-1].astype(int), len(self.peaks) - 1)
        after = np.maximum(np.ceil(edges[1:]).astype(int), first + 1)
        low = [self.peaks[a:b, 0].min() for a, b in zip(first, after, strict=True)]
        high = [self.peaks[a:b, 1].max() for a, b in zip(first, after, strict=True)]
        return np.column_stack([low, high])


Values = Sequence[float | None]
Series = Mapping[str, Values]

_KINDS: dict[str, RGB] = {What.TRAINED: SECOND, What.DECODED: ACCENT}
_QUALITY = {f"{metric.name}_{kind}": (metric, kind) for metric in METRICS if metric.plotted for kind in _KINDS}
PLOTTED = (*_QUALITY, "bytes", FLICKER.name)  # what is shown of every frame


def plots_of(
    series: Series, whose: str = "mean", other: Series | None = None, short: str = "", of: str = ""
) -> tuple[Plot, ...]:
    """The plots of a take that have values. `whose`: camera or cameras of the quality; `short`: in fewer words."""
    *measured, size, flicker = ((series.get(name, ()), (other or {}).get(name, ())) for name in PLOTTED)
    kilobytes, others = ([None if value is None else value / 1000 for value in sizes] for sizes in size)

    def quality(metric: Metric, kind: str, own: Values, other: Values) -> Plot:
        title = f"{metric.title} {kind}, "
        return Plot(title + whose, own, _KINDS[kind], metric.unit, other=other, short=title + (short or whose))

    plots = (
        *(quality(*metric, *pair) for metric, pair in zip(_QUALITY.values(), measured, strict=True)),
        Plot(f"KB per frame{of or ', group mean'}", kilobytes, SECOND, "KB", bars=True, other=others),
        Plot(f"{FLICKER.title.capitalize()}{of}", flicker[0], ACCENT, "/255", bars=True, other=flicker[1]),
    )
    return tuple(plot for plot in plots if plot.range is not None)


def clock_words(seconds: float) -> str:
    """A time of the take: in seconds, or from one minute on in minutes and seconds."""
    minutes, hundredths = divmod(round(100 * seconds), 6000)
    return f"{minutes}:{hundredths / 100:05.2f}" if minutes else f"{hundredths / 100:.2f} s"


@dataclass(frozen=True)
class TimelinePlots:
    """Plots above the track, on the same frame axis; clicking any of them seeks."""

    width: int
    height: int
    em: float
    frame_count: int
    group_starts: Sequence[int] = (0,)
    zoom: TimelineZoom = WHOLE
    kept: range | None = None
    strip: int = 0  # height of the strip of images above the plots, pixels; 0 for none
    span: tuple[int, int] | None = None  # first and last frame of the selected span; None for none
    fps: float = 0.0  # frame rate, for times beside the numbers of frames; 0 for none
    numbers: FrameNumbers = field(default_factory=FrameNumbers)  # by which people know the frames

    @property
    def left(self) -> int:
        """Column where frame 0 begins; the titles are to the left of it."""
        return min(round(18.5 * self.em), self.width // 3)

    @property
    def right(self) -> int:
        """Columns to the right of the last frame, for the ends of the axes."""
        return min(round(4.4 * self.em), self.width // 8)

    @property
    def track_height(self) -> int:
        """Height of the timeline's track at the bottom, in pixels."""
        return max(round(1.5 * self.em), 10)

    @cached_property  # drawing uses it for each value
    def timeline(self) -> Timeline:
        """Mapping of columns, counted from `left`, to frames."""
        width = max(self.width - self.left - self.right, 1)
        return Timeline(width, self.track_height, self.frame_count, self.group_starts, self.zoom, self.kept)

    def frame_at(self, x: float) -> int:
        """The frame under a column of the image."""
        return self.timeline.frame_at(x - self.left)

    def base(self, plots: Sequence[Plot], strip: np.ndarray | None = None) -> np.ndarray:
        """(height, width, 3) uint8: everything that does not depend on the frame. Cache it: playback draws it often."""
        canvas = Canvas(self.width, self.height, PANEL)
        timeline = self.timeline
        for number, plot in enumerate(plots):
            self._plot(canvas, timeline, plot, *self._rows(len(plots))[number])
        self._ruler(canvas, timeline)
        timeline.shade(canvas.pixels[: self._track, self.left : self.left + timeline.width])
        if strip is not None:
            canvas.image(self.left, GAP, strip)
            words = "Frames; drag to select some"
            canvas.text(
                0, GAP + strip.shape[0] / 2 - self._size(99) * 0.62, words, self._size(99), DIM, width=self.left
            )
        self._span_marks(canvas, timeline)
        words = "Frame"
        if self.zoom.shown is not None:
            first, last = (self.numbers.number(timeline.frame_at(x)) for x in (0, timeline.width - 1))
            words = f"Frame, {first} to {last} in view"
        canvas.text(0, self._track + self.track_height / 2 - self._size(99) * 0.62, words, self._size(99), DIM)
        return canvas.pixels

    def with_head(
        self,
        base: np.ndarray,
        frame: int | None,
        plots: Sequence[Plot],
        marks: Iterable[int] = (),
        keys: Iterable[int] = (),
        hover: int | None = None,
    ) -> np.ndarray:
        """A copy of `base` with track, marked frames, views of the camera path (`keys`), playhead and the frame's
        values, and those of the frame under the pointer."""
        canvas = Canvas.of(base.copy())
        timeline = self.timeline
        canvas.image(self.left, self._track, timeline.picture(frame))
        for marked in self.numbered:
            middle = self.left + sum(timeline.span(marked)) // 2
            canvas.rect(middle, self._track, max(round(self.em / 16), 1), self.track_height // 4, DIM)
        for mark in marks:
            if mark < self.frame_count and timeline.shows(mark):
                canvas.rect(self.left + sum(timeline.span(mark)) / 2 - 2, self._track - GAP, 4, MARK_HEIGHT, BAD)
        for x, y in filter(None, self._diamonds(keys)):
            canvas.diamond(x, y, KEY_SIZE * self.em, FAIR)
        if frame is None:
            return canvas.pixels
        size, number = self._size(99), str(self.numbers.number(frame))
        right = self.left - 8
        canvas.text(right, self._track + self.track_height / 2 - size * 0.62, number, size, TEXT, align="right")
        for plot, (y, height) in zip(plots, self._rows(len(plots)), strict=True):
            value = plot.values[frame] if frame < len(plot.values) else None
            if value is None:
                continue
            size = self._size(height)
            words = self._words(plot, frame)
            canvas.text(right, y + height / 2 - size * 0.62, words, size, TEXT, align="right")
            self._value(canvas, frame, value, plot.range, (y, height), plot.color, plot.bars)
        if not timeline.shows(frame):
            return canvas.pixels
        first, last = timeline.span(frame)
        head = self.left + (first + last - 1) // 2
        below = canvas.pixels[GAP : self._track - GAP, head].astype(np.float32)
        canvas.pixels[GAP : self._track - GAP, head] = (below * 0.4 + np.array(ACCENT) * 0.6).astype(np.uint8)
        if hover is not None:
            self._hover(canvas, hover, plots)
        return canvas.pixels

    def key_at(self, x: float, y: float, keys: Sequence[int]) -> int | None:
        """Index of the view of the camera path at a position, the topmost; None if there is none."""
        reach = 1.6 * KEY_SIZE * self.em
        near = [
            index
            for index, place in enumerate(self._diamonds(keys))
            if place is not None and abs(place[0] - x) <= reach and abs(place[1] - y) <= reach
        ]
        return near[-1] if near else None

    def _diamonds(self, keys: Iterable[int]) -> list[tuple[float, float] | None]:
        """The middle of each view's diamond, pixels; None if it is not in view."""
        timeline = self.timeline
        middle = self._track + self.track_height - (KEY_SIZE + 0.1) * self.em
        frames = [min(key, self.frame_count - 1) for key in keys]
        return [(self.left + sum(timeline.span(at)) / 2, middle) if timeline.shows(at) else None for at in frames]

    def _hover(self, canvas: Canvas, frame: int, plots: Sequence[Plot]) -> None:
        """A line at the frame under the pointer, with its number and values beside it."""
        first, last = self.timeline.span(frame)
        column = self.left + (first + last - 1) // 2
        canvas.rect(column, GAP, 1, self.height - GAP, TEXT)
        places = self._rows(len(plots))
        rows = [(self._words(plot, frame), y + high / 2) for plot, (y, high) in zip(plots, places, strict=True)]
        rows.append((f"frame {self.numbers.number(frame)}", self._track + self.track_height / 2))
        size, end = self._size(99), self.left + self.timeline.width  # right of it are the ends of the axes
        widest = max(text_width(words, size) for words, _ in rows) + 10
        for words, middle in rows:
            if not words:
                continue
            width = text_width(words, size) + 10
            left = column + 6 if column + 6 + widest <= end else max(column - 6 - width, self.left)
            canvas.rect(left, middle - 0.7 * size, width, 1.4 * size, GROUND)
            canvas.text(left + 5, middle - 0.62 * size, words, size, TEXT)

    @staticmethod
    def _words(plot: Plot, frame: int) -> str:
        value = plot.values[frame] if frame < len(plot.values) else None
        other = plot.other[frame] if frame < len(plot.other) else None
        against = "" if other is None else f" ({other:.2f})"
        return "" if value is None else f"{value:.2f}{against} {plot.unit}"

    @property
    def _track(self) -> int:
        return self.height - self.track_height

    def _rows(self, count: int) -> list[tuple[int, int]]:
        """(top, height) of each plot."""
        top = GAP + (self.strip + GAP if self.strip else 0)
        each = (self._track - round(RULER * self.em) - top) // max(count, 1) - GAP
        return [(top + number * (each + GAP), each) for number in range(count)]

    def _ruler(self, canvas: Canvas, timeline: Timeline) -> None:
        """Numbers of frames above the track, with their times where there is room for all of them."""
        size = max(round(0.64 * self.em), 8)
        y = self._track - round(RULER * self.em)
        labels = {frame: str(self.numbers.number(frame)) for frame in self.numbered}
        if self.fps > 0 and len(labels) > 1:
            timed = {frame: f"{words} · {clock_words(frame / self.fps)}" for frame, words in labels.items()}
            first, second, *_ = labels
            apart = timeline.span(second)[0] - timeline.span(first)[0]
            if max(text_width(words, size) for words in timed.values()) + self.em <= apart:
                labels = timed
        for frame, words in labels.items():
            middle = self.left + sum(timeline.span(frame)) // 2
            beside = text_width(words, size) / 2
            x = min(max(middle, self.left + beside), self.left + timeline.width - beside)
            canvas.text(x, y - 0.1 * size, words, size, DIM, align="middle")

    @property
    def numbered(self) -> list[int]:
        """The frames whose numbers are above the track: every 1, 2, 5, 10, 20, 50, ... in view."""
        timeline = self.timeline
        each = timeline.width / timeline.shown
        step = next(step for step in _STEPS if step * each >= APART * self.em or step >= self.frame_count)
        return [frame for frame in range(0, self.frame_count, step) if timeline.shows(frame)]

    def in_strip(self, y: float) -> bool:
        """Whether a row of the image is in the strip of images."""
        return self.strip > 0 and y < GAP + self.strip

    def _span_marks(self, canvas: Canvas, timeline: Timeline) -> None:
        """Darken what is outside of the selected span, and draw its edges."""
        if self.span is None:
            return
        left, right = timeline.span(self.span[0])[0], timeline.span(self.span[1])[1]
        above = canvas.pixels[: self._track - 1, self.left : self.left + timeline.width]
        for columns in (slice(0, left), slice(right, None)):
            above[:, columns] = (0.55 * above[:, columns] + 0.45 * np.array(PANEL)).astype(np.uint8)
        for frame, column in ((self.span[0], left), (self.span[1], right - 2)):
            if timeline.shows(frame):
                canvas.rect(self.left + column, 0, 2, self._track - 1, FAIR)
        if right > left:
            canvas.rect(self.left + left, 0, right - left, 2, FAIR)

    def _size(self, height: int) -> int:
        return max(min(round(0.78 * self.em), height - 1), 8)

    def _value(
        self, canvas: Canvas, frame: int, value: float, limits: tuple[float, float] | None, row: tuple[int, int],
        color: RGB, bars: bool,
    ) -> None:  # fmt: skip
        """Draw a value, between limits, as a bar or a line in a row (top, height)."""
        timeline, (y, height) = self.timeline, row
        if limits is None or not timeline.shows(frame):
            return
        bar = max(round((value - limits[0]) / (limits[1] - limits[0]) * (height - 2)), 1)
        first, last = timeline.span(frame)
        thick = bar if bars else min(max(round(self.em / 8), 2), bar)  # as thick on a dense screen
        canvas.rect(self.left + first, y + height - 1 - bar, max(last - first - (last - first > 3), 1), thick, color)

    def _plot(self, canvas: Canvas, timeline: Timeline, plot: Plot, y: int, height: int) -> None:
        size = self._size(height)
        against = " (00.00)" if any(value is not None for value in plot.other) else ""
        room = self.left - 16 - text_width(f"00.00{against} {plot.unit}", size)
        title = plot.short if plot.short and text_width(plot.title, size) > room else plot.title
        canvas.text(0, y + height / 2 - size * 0.62, title, size, DIM, width=room)
        canvas.rect(self.left, y, timeline.width, height, RAISED)
        for start in self.group_starts:
            if 0 < start < self.frame_count and timeline.shows(start):
                canvas.rect(self.left + timeline.span(start)[0], y, 1, height, LINE)
        if isinstance(plot, Waveform):
            self._waveform(canvas, plot, y, height)
            return
        limits = plot.range
        for series, color, bars in ((plot.values, _dimmed(plot.color), plot.bars), (plot.other, FAIR, False)):
            for index, value in enumerate(series[: self.frame_count]):
                if value is not None:
                    self._value(canvas, index, value, limits, (y, height), color, bars)
        self._axis(canvas, plot, y, height)

    def _axis(self, canvas: Canvas, plot: Plot, y: float, height: float) -> None:
        """The lowest and the highest value of a row, at its right at their heights, or if too close, side by side."""
        assert plot.extremes is not None
        assert plot.range is not None
        size = max(round(0.68 * self.em), 8)
        bottom, top = plot.range
        words = [f"{value:.{1 if abs(value) < 100 else 0}f}" if value else "0" for value in plot.extremes]
        below, above = (y + height * (top - value) / (top - bottom) - 0.62 * size for value in plot.extremes)
        below, above = min(below, y + height - 1.1 * size), max(above, y - 0.1 * size)
        left, room = self.left + self.timeline.width + 0.3 * self.em, self.right - 0.3 * self.em
        if below - above >= 1.1 * size:
            canvas.text(left, above, words[1], size, DIM, width=room)
            canvas.text(left, below, words[0], size, DIM, width=room)
            return
        both = words[0] if words[0] == words[1] else " – ".join(words)
        canvas.text(left, y + height / 2 - 0.62 * size, both, size, DIM, width=room)

    def _waveform(self, canvas: Canvas, plot: Waveform, y: int, height: int) -> None:
        if not len(plot.peaks):
            return
        middle, half = y + height / 2, (height - 2) / 2
        start = self.zoom.first / self.frame_count
        end = start + self.timeline.shown / self.frame_count
        loudest = max(float(np.abs(plot.peaks).max()), 1e-3)  # fills the row, so that a quiet take is seen too
        for column, (low, high) in enumerate(plot.columns(self.timeline.width, start, end) / loudest):
            top, bottom = middle - high * half, middle - low * half
            canvas.rect(self.left + column, top, 1, max(bottom - top, 1), _dimmed(plot.color))


def _dimmed(color: RGB) -> RGB:
    return tuple(round(0.5 * channel + 0.5 * ground) for channel, ground in zip(color, RAISED, strict=True))  # type: ignore[return-value]
