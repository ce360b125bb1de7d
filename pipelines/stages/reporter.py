"""Reports what a stage does: progress with the time left, figures, previews and warnings."""

import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from v3studio.pipelines.events import Emit, Event, Log, Metrics, Preview, Progress, Warned
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.studio.errors import Message
from v3studio.studio.json_types import JsonData
from v3studio.studio.progress import ProgressFn

_LEAST_PAUSE = 0.2  # shortest interval in seconds between two progress events of a stage

_WARM_SHARE, _WARM_SECONDS = 0.3, 30.0
"""Progress and seconds since the first progress of a stage; before either is reached, its time left is unknown. No more
seconds than these, nor half of all, are taken for warming up."""

_LEAST_SECONDS = 10.0  # seconds of a stage, and of a run, before which the time left is unknown in any case

_LEAST_SHARE = 0.1
"""Least share of a run, by the weights of its stages, from which the time left of the whole is estimated: how the first
stages compare to training differs 15-fold with footage, masks and machine, so training itself must have begun."""

_SHARE = 0.1
"""Time constant of corrections as a share of the time left: a correction is mostly made after a tenth of the rest."""

_EARLY = 0.25  # the same at first, as a share of the time since the first estimate
_LEAST_CONSTANT = 0.5  # shortest time constant in seconds


class Countdown:
    """Seconds left: decreases with the clock and moves smoothly toward new estimates.

    Single steps that take unusually long, and estimates that change when a new kind of step is measured for the first
    time, change an estimate at once. Shown directly, it jumps up and down, so the difference between an estimate and
    the countdown is corrected exponentially over time.
    """

    def __init__(self) -> None:
        self._left: float | None = None
        self._at = self._began = 0.0

    def estimate(self, now: float, seconds: float) -> float:
        """Take in an estimate, seconds left at `now` on a clock that does not run backward; returns the countdown."""
        expected = self.at(now)
        if expected is None:
            self._left, self._began = seconds, now
        else:
            # the first estimates are the least certain, so they are corrected faster
            constant = max(_LEAST_CONSTANT, min(_EARLY * (now - self._began), _SHARE * min(expected, seconds)))
            self._left = expected + (1 - math.exp(-(now - self._at) / constant)) * (seconds - expected)
        self._at = now
        return self._left

    def at(self, now: float) -> float | None:
        """Seconds left at `now` if nothing has changed; None before the first estimate."""
        return None if self._left is None else max(0.0, self._left - (now - self._at))


@dataclass
class StageReporter:
    """Emits a stage's events: progress with time left, figures, previews, warnings. Thread-safe."""

    stage: str
    emit: Emit = lambda event: None
    cancellation: Cancellation = field(default_factory=Cancellation)
    clock: Callable[[], float] = time.monotonic  # work time in seconds; does not advance while the run is paused
    own: float = 1.0  # own, later: expected weight of this stage and of all later ones in the run
    later: float = 0.0
    before: float = 0.0  # seconds that the run took before this stage
    total_fraction: float = 0.0  # progress of the run, 0 to 1; never decreases
    earlier: float = 0.0  # expected weight of the stages that took `before`
    run: Countdown = field(default_factory=Countdown)  # time left of the run, handed from stage to stage

    def __post_init__(self) -> None:
        self._began = self._started = self.clock()
        self._last = -_LEAST_PAUSE
        self._fraction = 0.0
        self._left = Countdown()
        self._warming: list[tuple[float, float]] = []  # seconds and fraction, from the first progress on
        self._lock = threading.Lock()
        self._warned: set[str] = set()  # codes of the warnings so far

    def check(self) -> None:
        self.cancellation.check()

    def progress(self, fraction: float, label: str = "", **figures: JsonData) -> None:
        """Report progress of the stage, 0 to 1; calls in quick succession are dropped."""
        self.check()
        with self._lock:
            self._progress(fraction, label, figures)

    def _progress(self, fraction: float, label: str, figures: Mapping[str, JsonData]) -> None:
        now = self.clock()
        fraction = self._fraction = max(self._fraction, fraction)  # a part may begin again
        raw = self._seconds_left(now - self._started, fraction)
        if now - self._last < _LEAST_PAUSE and fraction < 1:
            return
        self._last = now
        left = total_left = None
        if raw is None:
            total_left = self.run.at(now)
        else:
            left = self._left.estimate(now, raw) if fraction < 1 else 0.0
            spent = self.before + now - self._began
            # seconds per weight, of all stages so far and this one
            pace = (spent + raw) / (self.earlier + self.own)
            share = (self.earlier + self.own * fraction) / max(self.earlier + self.own + self.later, 1e-9)
            if not self.later and fraction == 1:
                total_left = 0.0
            elif spent >= _LEAST_SECONDS and (share >= _LEAST_SHARE or not self.later):
                total_left = self.run.estimate(now, raw + self.later * pace)
            else:
                total_left = self.run.at(now)
            if total_left is not None:
                self.total_fraction = max(self.total_fraction, min(1.0, spent / max(spent + total_left, 1e-9)))
        self._tell(left, total_left, label, figures)

    def _tell(self, left: float | None, total_left: float | None, label: str, figures: Mapping[str, JsonData]) -> None:
        self.emit(
            Progress(
                stage=self.stage,
                fraction=self._fraction,
                total_fraction=self.total_fraction,
                seconds_left=left,
                total_seconds_left=total_left,
                label=label,
                figures=figures,
            )
        )

    def _seconds_left(self, elapsed: float, fraction: float) -> float | None:
        """Seconds left by the mean pace since the first progress, or, if that is faster, since the stage warmed up."""
        if fraction > 0 and (not self._warming or elapsed <= self._warming[0][0] + _WARM_SECONDS):
            self._warming.append((elapsed, fraction))
        if fraction == 1:
            return 0.0
        start, first = self._warming[0] if self._warming else (elapsed, fraction)
        spent = elapsed - start
        early = spent < _LEAST_SECONDS or (fraction < _WARM_SHARE and spent < _WARM_SECONDS)
        if early or fraction < 0.01 or fraction <= first:
            return None
        warm = start + min(spent / 2, _WARM_SECONDS)
        since, behind = next(point for point in reversed(self._warming) if point[0] <= warm)
        pace = min(spent / (fraction - first), (elapsed - since) / max(fraction - behind, 1e-9))
        return (1 - fraction) * pace

    def start_clock(self) -> None:
        """Start the clock for estimates of the time left; earlier checks and warm-up do not count."""
        self._started = self.clock()
        self._warming.clear()

    def part(self, label: str, start: float = 0.0, stop: float = 1.0) -> ProgressFn:
        """A progress callback for library functions, mapped to the range `start` to `stop` of this stage."""

        def report(done: int, total: int, **figures: JsonData) -> None:
            fraction = done / total if total else 0.0
            self.progress(start + (stop - start) * min(1.0, fraction), label, **figures)

        return report

    def counting(self, label: str) -> ProgressFn:
        """A progress callback for what is done before the clock starts or after its end, in words: "LABEL 3 of 20"."""

        def report(done: int, total: int, **figures: JsonData) -> None:
            self.check()
            with self._lock:
                now = self.clock()
                if now - self._last >= _LEAST_PAUSE:
                    self._last = now
                    self._tell(None, self.run.at(now), f"{label} {done} of {total}", figures)

        return report

    def _emit(self, event: Event) -> None:
        with self._lock:
            self.emit(event)

    def metrics(self, values: Mapping[str, JsonData], group: int | None = None, frame: int | None = None) -> None:
        """Report final figures of a frame, a group or the stage, by name."""
        self._emit(Metrics(stage=self.stage, values=values, group=group, frame=frame))

    def preview(self, path: Path, caption: str, **where: Any) -> None:
        """Report a preview image at `path`; `where`: other attributes of `Preview`."""
        self._emit(Preview(stage=self.stage, path=str(path), caption=caption, **where))

    def log(self, message: str) -> None:
        """Report a detail; see `Log`."""
        self._emit(Log(stage=self.stage, message=message))

    def warn(self, message: Message, once: bool = False) -> None:
        """Report a warning; `once`: only the first of this code."""
        with self._lock:
            if once and message.code in self._warned:
                return
            self._warned.add(message.code)
            self.emit(Warned.of(message, stage=self.stage))
