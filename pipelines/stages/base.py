"""What a stage is, and what it is given to work with."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from pipelines.config import Config
from pipelines.events import Emit, Event, Log, Metrics, Preview, Progress, Warned
from pipelines.events.cancellation import Cancellation
from pipelines.stages.device import choose_device
from pipelines.stages.footage import TakeFootage
from pipelines.stages.grouping import groups_of
from pipelines.stages.params import Params
from pipelines.takes.groups import Group
from pipelines.takes.take import Take
from studio.progress import ProgressFn

if TYPE_CHECKING:
    from studio.perceptual import Lpips

_LEAST_PAUSE = 0.2
"""Seconds between two progress events of a stage."""


@dataclass
class Context:
    """A take at work: its settings, where events go, the flag that stops it, and the footage once it is opened."""

    take: Take
    config: Config
    emit: Emit = lambda event: None
    cancellation: Cancellation = field(default_factory=Cancellation)
    clock: Callable[[], float] = time.monotonic
    """Seconds of work: a run's stands still while it is paused."""

    @cached_property
    def footage(self) -> TakeFootage:
        """The footage, opened when it is first asked for."""
        return TakeFootage(self.take, self.config)

    @property
    def groups(self) -> tuple[Group, ...]:
        """The take's frames, cut into groups; see `pipelines.stages.grouping`."""
        return groups_of(self.footage)

    @property
    def threads(self) -> int:
        """CPU threads that the run may use."""
        return self.config.run.threads or len(os.sched_getaffinity(0))

    @cached_property
    def device(self) -> str:
        """Where training and drawing run: "cpu", "cuda" or "cuda:1"."""
        return choose_device(self.config.run.device)

    @cached_property
    def lpips(self) -> Lpips | None:
        """What LPIPS is measured with, loaded when it is first asked for; None where it is not to be measured.

        Raises:
            StudioError: the network's weights cannot be fetched or read.
        """
        if self.config.evaluate.lpips is None:
            return None
        from studio.perceptual import Lpips

        return Lpips(self.config.evaluate.lpips, self.device)


@dataclass
class StageReporter:
    """How a stage talks: progress with time left, figures, pictures, warnings. Checks for cancellation each time.
    Thread safe.

    Attributes:
        stage: its name.
        context: where events go and what stops it.
        own, later: the stage's share of the run and that of the stages after it, before anything is measured.
        before: seconds that the run took until this stage began.
        total_fraction: how far the run is, 0 to 1; never goes back.
    """

    stage: str
    context: Context
    own: float = 1.0
    later: float = 0.0
    before: float = 0.0
    total_fraction: float = 0.0

    def __post_init__(self) -> None:
        self._began = self._clock = self.context.clock()
        self._last = -_LEAST_PAUSE
        self._fraction = 0.0
        self._lock = threading.Lock()

    def progress(self, fraction: float, label: str = "", **figures: Any) -> None:
        """Tell how far the stage is, 0 to 1. Calls that follow each other quickly are not passed on.

        Raises:
            Cancelled: the run was asked to stop.
        """
        self.context.cancellation.check()
        with self._lock:
            self._progress(fraction, label, figures)

    def _progress(self, fraction: float, label: str, figures: dict[str, Any]) -> None:
        # estimates of what is left may grow; what is behind stays behind
        fraction = self._fraction = max(self._fraction, fraction)
        now = self.context.clock()
        if now - self._last < _LEAST_PAUSE and fraction < 1:
            return
        self._last = now
        left = _seconds_left(now - self._clock, fraction)
        total_left = None
        if left is not None:
            total_left = left + (now - self._clock) / fraction * self.later / self.own
            spent = self.before + now - self._began
            self.total_fraction = max(self.total_fraction, min(1.0, spent / (spent + total_left)))
        self.context.emit(
            Progress(
                stage=self.stage,
                fraction=fraction,
                total_fraction=self.total_fraction,
                seconds_left=left,
                total_seconds_left=total_left,
                label=label,
                figures=figures,
            )
        )

    def start_clock(self) -> None:
        """What went before (checks, warming up) says nothing about how long the rest takes."""
        self._clock = self.context.clock()

    def part(self, label: str, start: float = 0.0, stop: float = 1.0) -> ProgressFn:
        """A callback for library functions that fills the stretch from `start` to `stop` of this stage."""

        def tell(done: int, total: int, **figures: Any) -> None:
            share = done / total if total else 0.0
            self.progress(start + (stop - start) * min(1.0, share), label, **figures)

        return tell

    def _emit(self, event: Event) -> None:
        with self._lock:
            self.context.emit(event)

    def metrics(self, values: dict[str, Any], group: int | None = None, frame: int | None = None) -> None:
        """Figures that are final for a frame, a group or the stage."""
        self._emit(Metrics(stage=self.stage, values=values, group=group, frame=frame))

    def preview(self, path: Path, caption: str, **where: Any) -> None:
        """A picture that now stands at `path`; `where` as in `Preview`."""
        self._emit(Preview(stage=self.stage, path=str(path), caption=caption, **where))

    def log(self, message: str) -> None:
        """A line for those who want to know more."""
        self._emit(Log(stage=self.stage, message=message))

    def warn(self, message: str) -> None:
        """Something the user should look at."""
        self._emit(Warned(stage=self.stage, message=message))


def _seconds_left(elapsed: float, fraction: float) -> float | None:
    """None until two seconds and a hundredth are behind us: earlier estimates jump."""
    if fraction < 1 and (elapsed < 2 or fraction < 0.01):
        return None
    return elapsed * (1 - fraction) / fraction


class Stage(Protocol):
    """A step from footage to stream. Stages know the take's layout and call `studio`; they hold no state.

    Attributes:
        name: as in the take and on the command line.
        title: what it does, for people.
        version: raised whenever its results change meaning or form; older results are then stale.
        weight: share of a run's time, roughly, before anything is measured.
        dependencies: stages whose results it reads.
    """

    @property
    def name(self) -> str: ...
    @property
    def title(self) -> str: ...
    @property
    def version(self) -> int: ...
    @property
    def weight(self) -> float: ...
    @property
    def dependencies(self) -> tuple[str, ...]: ...

    def params(self, context: Context) -> Params:
        """Settings and inputs that the results are made from; other stages' results are added by the runner."""
        ...

    def results(self, context: Context) -> list[Path]:
        """Files that the stage leaves; later stages depend on their content."""
        ...

    def units(self, context: Context) -> tuple[int, int, str] | None:
        """Units that are finished and still valid, units in all, what they are called; None where it has none."""
        ...

    def run(self, context: Context, reporter: StageReporter) -> dict[str, Any]:
        """Make the results, going on from finished units; returns figures for the summary line.

        Raises:
            StudioError: bad input.
            Cancelled: the run was asked to stop.
        """
        ...


def leftover(folder: Path, wanted: Sequence[Path], pattern: str) -> list[Path]:
    """Entries of `folder` that match `pattern` and are not wanted (of an earlier, longer run)."""
    return [path for path in sorted(folder.glob(pattern)) if path not in set(wanted)]
