"""RunState: a run's progress and results so far, collected from its events."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field, replace
from enum import StrEnum

from v3studio.gui.models.stage_rows import message_text, stage_name
from v3studio.gui.models.take.log_words import metrics_words
from v3studio.pipelines import events
from v3studio.pipelines.reports.terminal import duration
from v3studio.pipelines.takes.results.summaries import summary_words

LOG_LINES = 2000
_ENDED = {"": "Run ended", "done": "Run finished", "failed": "Run failed", "cancelled": "Run cancelled"}  # by outcome
CURVE_POINTS = 4000
SILENT = 10.0  # seconds without progress after which the time that the step takes is told


class Outcome(StrEnum):
    """The way in which a run has ended."""

    OPEN = ""  # it has not ended
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


class Level(StrEnum):
    """Severity of a line of the log."""

    PLAIN = ""
    WARNING = "warning"
    ERROR = "error"


@dataclass
class Curve:
    """A training metric over progress (0 to 1); every other point is dropped when there are CURVE_POINTS."""

    positions: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    def add(self, position: float, value: float) -> None:
        self.positions.append(position)
        self.values.append(value)
        if len(self.positions) > CURVE_POINTS:
            del self.positions[::2], self.values[::2]


@dataclass(frozen=True)
class LogLine:
    """A line of the log. `told`: seconds since 1970; 0 if unknown. `notice`: the warning or error that it tells."""

    level: Level
    text: str
    told: float = 0.0
    notice: events.Notice | None = None


@dataclass
class RunState:
    """The progress and the results of a run."""

    planned: tuple[str, ...] = ()  # stages that the run will execute, in order
    stage: str = ""  # the current stage; "" before the first and after the last
    progress: events.Progress | None = None
    finished: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)  # error message by stage
    # the setting that fixes the error, by stage, where there is one
    failed_setting: dict[str, str] = field(default_factory=dict)
    warnings: dict[str, list[events.Warned]] = field(default_factory=dict)  # of this run, by stage
    outcome: Outcome = Outcome.OPEN
    # the log, newest last, with that of earlier runs
    lines: deque[LogLine] = field(default_factory=lambda: deque(maxlen=LOG_LINES))
    # loss, psnr, splats over the progress of training, one curve per group, since groups train in parallel
    curves: dict[str, dict[int, Curve]] = field(default_factory=dict)
    previews: dict[str, events.Preview] = field(default_factory=dict)  # latest image by camera
    begun: bool = False
    changes: int = 0  # incremented with every event
    _trained: float = 0.0
    _now: float = 0.0
    heard: float = 0.0  # when the stage last told of its progress, by `time.monotonic`
    results: int = 0  # incremented when the take has new results: a frame, a group, a stage

    def followed(self) -> RunState:
        """The state of the next run: empty except for the log, and training curves and previews until it trains."""
        return RunState(
            lines=deque((replace(line, notice=None) for line in self.lines), maxlen=LOG_LINES),
            curves=self.curves,
            previews=self.previews,
            changes=self.changes + 1,
            results=self.results + 1,
            _trained=self._trained,
        )

    def apply(self, event: events.Event) -> None:
        self.changes += 1
        self._now = event.time
        if isinstance(event, events.RunStarted):
            self.planned = event.stages
            todo = ", ".join(map(stage_name, event.stages)) or "nothing to do, everything is up to date"
            self._say(f"Run started: {todo}")
        elif isinstance(event, events.StageStarted):
            self.stage, self.progress, self.heard = event.stage, None, time.monotonic()
            self.failed.pop(event.stage, None)
            self._say(f"{stage_name(event.stage)}: started{f' ({event.reason})' if event.reason else ''}")
        elif isinstance(event, events.Progress):
            self.progress, self.heard = event, time.monotonic()
            if event.stage == "train":
                self._train_figures(event)
        elif isinstance(event, events.Metrics):
            self.results += 1
            if event.group is not None:  # figures of a whole stage are those of StageFinished
                self._say(metrics_words(event))
        elif isinstance(event, events.GroupStarted):
            gpu = f", GPU {event.gpu}" if event.gpu else ""
            self._say(f"{stage_name(event.stage)}: group {event.group} started on {event.node}{gpu}")
        elif isinstance(event, events.Preview):
            self.previews[event.camera or event.stage] = event
        elif isinstance(event, events.Log):
            self._say(event.message)
        elif isinstance(event, events.Warned):
            self.warnings.setdefault(event.stage, []).append(event)
            self._say(message_text(event), Level.WARNING, event)
        elif isinstance(event, events.StageFinished):
            self.finished.append(event.stage)
            self.stage, self.progress = "", None
            self.results += 1
            figures = summary_words(event.stage, event.summary)
            self._say(f"{stage_name(event.stage)}: done in {duration(event.seconds)}{figures and '. '}{figures}")
        elif isinstance(event, events.StageFailed):
            self.failed[event.stage] = message_text(event)
            self.failed_setting[event.stage] = str(event.fields.get("setting", ""))
            self._say(f"{stage_name(event.stage)}: {message_text(event)}", Level.ERROR, event)
            for line in event.traceback.splitlines():
                self._say(line, Level.ERROR)
        elif isinstance(event, events.Finished):
            self.outcome, self.stage, self.progress = Outcome(event.outcome), "", None
            self.results += 1
            repeated = message_text(event) in self.failed.values()
            text = f"{_ENDED[self.outcome]} after {duration(event.seconds)}"
            text += "" if repeated or not event.message else f": {message_text(event)}"
            self._say(text, Level.ERROR if self.outcome == Outcome.FAILED else Level.PLAIN)

    def crashed(self, message: str, tail: str = "") -> None:
        """Note that the process ended without an outcome."""
        self.changes += 1
        self._now = 0.0
        if self.stage:
            self.failed[self.stage] = message
        self.outcome, self.stage, self.progress = Outcome.FAILED, "", None
        for line in tail.splitlines()[-40:]:
            self._say(line, Level.ERROR)
        self._say(message, Level.ERROR)

    def note(self, text: str, failed: bool = False) -> None:
        """Add a line to the log that comes from no event."""
        self.changes += 1
        self._now = time.time()
        self._say(text, Level.ERROR if failed else Level.PLAIN)

    def _say(self, text: str, level: Level = Level.PLAIN, notice: events.Notice | None = None) -> None:
        self.begun = True
        self.lines.append(LogLine(level, text, self._now, notice))

    def _train_figures(self, event: events.Progress) -> None:
        if event.fraction < self._trained:  # training has started over
            self.curves.clear()
        self._trained = event.fraction
        for name in ("loss", "psnr", "splats"):
            value = event.figures.get(name)
            if isinstance(value, int | float) and not isinstance(value, bool):
                number = event.figures.get("group")
                group = number if isinstance(number, int) else 0
                self.curves.setdefault(name, {}).setdefault(group, Curve()).add(event.fraction, float(value))

    def stage_words(self) -> str:
        """ "42%, 3 min 05 s left" for the running stage; the step while the time left is not known, and for how long it
        has been at it if it should be over by now. "" if none runs."""
        if not self.stage:
            return ""
        quiet, left = time.monotonic() - self.heard, self.progress and self.progress.seconds_left
        words = percent(self.progress.fraction) if self.progress is not None else "starting"
        if quiet > SILENT + (left or 0.0):
            return f"{words}, at this step for {duration(quiet)}"
        if self.progress is None or left is not None:
            return f"{words}, {duration(left)} left" if left and left >= 1 else words
        return f"{words}, {self.progress.label or 'estimating'}"


def percent(fraction: float) -> str:
    """Return how much is done, 0 to 1, as in "42%"; 100% means that nothing is left."""
    return f"{int(100 * fraction + 1e-6)}%"
