"""The job log, drawn as an image: lines with their time and level, and buttons that fix what warnings tell of."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np

from v3studio.gui.drawing.areas import Areas
from v3studio.gui.drawing.canvas import Canvas, line_height, text_width, wrapped
from v3studio.gui.drawing.palette import ACCENT, BAD, DIM, FAIR, GOOD, PANEL, RGB, TEXT
from v3studio.gui.models.take.inspector import heading
from v3studio.gui.models.take.remedies import Fix, fix_of
from v3studio.gui.models.take.run_state import Level, LogLine
from v3studio.pipelines.config import Config
from v3studio.studio.counts import listed

LEVELS: dict[Level, tuple[str, RGB, RGB]] = {
    Level.PLAIN: ("", DIM, TEXT),
    Level.WARNING: ("Warning: ", FAIR, FAIR),
    Level.ERROR: ("Error: ", BAD, BAD),
}
"""How lines of a level begin, and the colors of their dots and of their text."""

WIDE, HANG = 30.0, 1.0
"""Width of the log from which on all rows of a line are aligned, and else the indent of those that continue it, em."""

CLOCK = "00:00:00"  # A time as wide as all others

TITLE = "Job log"


@dataclass(frozen=True)
class LogRow:
    """A row of the image: time of day, "" in the rows that continue a line, and where it is not known; whether a line
    begins here; what the button does, if it has one."""

    level: Level
    text: str
    clock: str = ""
    first: bool = False
    fix: Fix | None = None


def grouped(lines: Iterable[LogLine]) -> list[LogLine]:
    """The log with one line for warnings in a row that differ in the camera's name only: the first, and which cameras.
    Those with figures of their own stay, so that no figure is hidden or reported for another camera."""
    kept = []
    for key, run in itertools.groupby(enumerate(lines), lambda numbered: _about(numbered[1]) or numbered[0]):
        same = [line for _, line in run]
        cameras = [line.notice.fields["camera"] for line in same if isinstance(key, tuple) and line.notice is not None]
        names = list(dict.fromkeys(map(str, cameras)))
        if len(names) < 2:
            kept += same
            continue
        kept.append(replace(same[0], text=f"{same[0].text} (in {len(names)} cameras: {listed(names, 3)})"))
    return kept


def _about(line: LogLine) -> tuple[object, ...]:
    """The parts that a warning about a camera shares with that about another one; () for other lines. Only a name in
    quotes is taken out: bare, that of camera 12 would also be the figure in "by 12%"."""
    notice = line.notice
    if line.level != Level.WARNING or notice is None or not notice.code or not notice.fields.get("camera"):
        return ()
    rest = {name: value for name, value in notice.fields.items() if name != "camera"}
    return (notice.code, line.text.replace(f"'{notice.fields['camera']}'", "''"), repr(rest))


def _size(em: float) -> int:
    return round(0.82 * em)


def _indent(em: float) -> float:
    """Column where the text begins."""
    return 0.6 * em + text_width(CLOCK, _size(em)) + 1.3 * em


def _hang(width: float, em: float) -> float:
    """Column where rows that continue a line begin: below its text, or below its time where there is little room."""
    return _indent(em) if width >= WIDE * em else 0.6 * em + HANG * em


def log_rows(lines: Iterable[LogLine], width: int, em: float, config: Config | None) -> list[LogRow]:
    """The log wrapped to the width, pixels, with the fixes of its lines for the take's settings."""
    rows: list[LogRow] = []
    room = width - _indent(em) - 0.6 * em
    spare = width - _hang(width, em) - 0.6 * em
    for line in lines:
        clock = _clock(line.told)
        words = LEVELS[line.level][0] + line.text
        parts = wrapped(words, _size(em), room)
        rest = words[len(parts[0]) :].removeprefix("\n").lstrip(" ")
        parts = [parts[0], *(wrapped(rest, _size(em), spare) if rest else [])]
        rows += [LogRow(line.level, part, clock * (not number), not number) for number, part in enumerate(parts)]
        fix = fix_of(line.notice, config)
        if fix is not None:
            rows.append(LogRow(Level.PLAIN, fix.words, fix=fix))
    return rows


def _clock(told: float) -> str:
    """Time of day; empty if unknown or not a time, as in a damaged file."""
    try:
        return datetime.fromtimestamp(told).strftime("%H:%M:%S") if told else ""
    except (OverflowError, ValueError, OSError):
        return ""


@dataclass
class LogView:
    """The rows in the image: it is scrolled `back` rows from the end, may be `large` and cover the view, and have
    only those of warnings and errors, whose number among all lines is `warnings`. Drawing notes what can be clicked:
    `areas` has its labels, `fixes` what buttons do; without a fix, it is the switch to warnings only."""

    rows: Sequence[LogRow]
    width: int
    height: int
    em: float
    back: int = 0
    large: bool = False
    warnings: int = 0
    only_warnings: bool = False
    areas: Areas[str] = field(default_factory=Areas)
    fixes: dict[str, Fix] = field(default_factory=dict)

    @property
    def _step(self) -> int:
        return line_height(_size(self.em))

    @property
    def top(self) -> float:
        """Height of the heading, pixels."""
        return 0.3 * self.em + line_height(round(0.95 * self.em)) + 0.2 * self.em

    @property
    def shown(self) -> Sequence[LogRow]:
        """The rows in the image, top to bottom."""
        count = max(int((self.height - self.top) // self._step), 1)
        end = max(len(self.rows) - self.back, min(count, len(self.rows)))
        return self.rows[max(end - count, 0) : end]

    def picture(self) -> np.ndarray:
        """(height, width, 3) uint8."""
        em, size, step = self.em, _size(self.em), self._step
        canvas = Canvas(self.width, self.height, PANEL)
        top = heading(canvas, 0.3 * em, TITLE, em)
        self._switches(canvas)
        if not self.rows:
            canvas.text(0.6 * em, top, "No warnings." if self.only_warnings else "The log is empty.", size, DIM)
        left = _indent(em)
        for number, row in enumerate(self.shown):
            y = top + number * step
            if row.fix is not None:
                self._button(canvas, y, row.text, row.fix)
                continue
            _, dot, color = LEVELS[row.level]
            canvas.text(0.6 * em, y, row.clock, size, DIM)
            if row.first:
                canvas.dot(left - 0.65 * em, y + 0.62 * size, 0.18 * em, dot)
            canvas.text(left if row.first else _hang(self.width, em), y, row.text, size, color)
        return canvas.pixels

    def _switches(self, canvas: Canvas) -> None:
        """Write in the heading that it can be enlarged and, if there are warnings and room, be limited to those."""
        em, size = self.em, _size(self.em)
        right = self.width - 0.6 * em
        right -= canvas.text(right, 0.3 * em, "close (J)" if self.large else "enlarge (J)", size, DIM, align="right")
        words = "all lines" if self.only_warnings else f"warnings only ({self.warnings})"
        left, wide = 1.8 * em + text_width(TITLE, round(0.95 * em)), text_width(words, size)
        if (self.warnings or self.only_warnings) and left + wide <= right - 0.8 * em:
            canvas.text(left, 0.3 * em, words, size, ACCENT if self.only_warnings else DIM)
            self.areas.add((left - 0.4 * em, 0, wide + 0.8 * em, self.top), words)

    def _button(self, canvas: Canvas, y: float, label: str, fix: Fix) -> None:
        """A button at a height. One with a long name begins below the clock, so that all of it is shown."""
        em, size, step = self.em, _size(self.em), self._step
        wide, most = text_width(label, size) + em, self.width - 0.4 * em
        left = max(min(_indent(em), most - wide), 0.4 * em)
        wide = min(wide, most - left)
        canvas.button(left, y + 1, wide, step - 2, label, size, color=GOOD if fix.done else ACCENT)
        self.areas.add((left, y, wide, step), label)
        self.fixes[label] = fix
