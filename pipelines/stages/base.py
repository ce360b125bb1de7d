"""The stage interface, and what stages work with: context and reporter."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
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
from pipelines.stages.time_left import Countdown
from pipelines.takes.atomic_files import Result
from pipelines.takes.groups import Group
from pipelines.takes.take import Take
from studio.errors import Message
from studio.json_types import JsonData
from studio.progress import ProgressFn

if TYPE_CHECKING:
    from studio.edits import CropBox, EditList
    from studio.perceptual import Lpips

_LEAST_PAUSE = 0.2
"""Shortest interval in seconds between two progress events of a stage."""

_WARM_SHARE, _WARM_SECONDS = 0.03, 30.0
"""Progress and seconds of a stage; before either is reached, its time left is unknown. No more seconds than these, nor
half of all, are taken for warming up."""

_LEAST_SHARE = 0.03
"""Least share of a run, by the weights of its stages, from which the time left of the whole is estimated: the first
stages are short, and how they compare to training differs with footage and machine."""


@dataclass
class Context:
    """A take with its settings, and what a run needs.

    Attributes:
        take: the take.
        config: all settings.
        emit: receives events.
        cancellation: flag that cancels the run.
        clock: work time in seconds; does not advance while the run is paused.
        executor: runs groups elsewhere; None: stages run them in this process.
        most_cached: see `TakeFootage`.
    """

    take: Take
    config: Config
    emit: Emit = lambda event: None
    cancellation: Cancellation = field(default_factory=Cancellation)
    clock: Callable[[], float] = time.monotonic
    executor: Executor | None = None
    most_cached: int | None = None

    @cached_property
    def footage(self) -> TakeFootage:
        """The footage, opened on first access."""
        return TakeFootage(self.take, self.config, self.most_cached)

    @property
    def edits(self) -> EditList:
        """The take's edits; see `TakeFootage.edits`."""
        return self.footage.edits

    @property
    def training_box(self) -> CropBox | None:
        """The crop box, if training sees only what is in front of it."""
        crop = self.edits.crop
        return crop if crop is not None and crop.training else None

    @property
    def groups(self) -> tuple[Group, ...]:
        """The take's frames in groups; see `pipelines.stages.grouping`."""
        return groups_of(self.footage)

    @property
    def threads(self) -> int:
        """Number of CPU threads to use."""
        return self.config.run.threads or len(os.sched_getaffinity(0))

    @cached_property
    def device(self) -> str:
        """torch device for training and rendering: "cpu", "cuda" or "cuda:1".

        Raises:
            StudioError: no such GPU (`run.no_gpu`).
        """
        return choose_device(self.config.run.device)

    @cached_property
    def lpips(self) -> Lpips | None:
        """The LPIPS metric, loaded on first access; None if `evaluate.lpips` is null.

        On the CPU if there is an executor, which measures elsewhere: this machine may have no GPU.

        Raises:
            StudioError: the weights of the network cannot be downloaded or read.
        """
        if self.config.evaluate.lpips is None:
            return None
        from studio.perceptual import Lpips

        return Lpips(self.config.evaluate.lpips, self.device if self.executor is None else "cpu")


@dataclass
class StageReporter:
    """Emits a stage's events: progress with time left, figures, previews, warnings. Thread-safe.

    Attributes:
        stage: name of the stage.
        context: receives the events.
        own, later: expected weight of this stage and of all later ones in the run.
        before: seconds that the run took before this stage.
        total_fraction: progress of the run, 0 to 1; never decreases.
        earlier: expected weight of the stages that took `before`.
        run: time left of the run, handed from stage to stage.
    """

    stage: str
    context: Context
    own: float = 1.0
    later: float = 0.0
    before: float = 0.0
    total_fraction: float = 0.0
    earlier: float = 0.0
    run: Countdown = field(default_factory=Countdown)

    def __post_init__(self) -> None:
        self._began = self._clock = self.context.clock()
        self._last = -_LEAST_PAUSE
        self._fraction = 0.0
        self._left = Countdown()
        self._warming = [(0.0, 0.0)]  # seconds and fraction while the stage warms up
        self._lock = threading.Lock()

    def progress(self, fraction: float, label: str = "", **figures: JsonData) -> None:
        """Report progress of the stage; calls in quick succession are dropped.

        Args:
            fraction: 0 to 1.
            label: the step in progress.
            figures: loss, psnr, splats, ...

        Raises:
            Cancelled: the run was cancelled.
        """
        self.context.cancellation.check()
        with self._lock:
            self._progress(fraction, label, figures)

    def _progress(self, fraction: float, label: str, figures: Mapping[str, JsonData]) -> None:
        now = self.context.clock()
        raw = self._seconds_left(now - self._clock, fraction)
        # estimates of the time left may grow, but progress never decreases
        fraction = self._fraction = max(self._fraction, fraction)
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
            if not self.later and fraction == 1:
                total_left = 0.0
            elif self._weighed(fraction) >= _LEAST_SHARE or not self.later:
                total_left = self.run.estimate(now, raw + self.later * pace)
            else:
                total_left = self.run.at(now)
            if total_left is not None:
                self.total_fraction = max(self.total_fraction, min(1.0, spent / max(spent + total_left, 1e-9)))
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

    def _seconds_left(self, elapsed: float, fraction: float) -> float | None:
        """From the pace since the stage has warmed up, until when it is far slower than later; None before."""
        if elapsed <= _WARM_SECONDS:
            self._warming.append((elapsed, fraction))
        if fraction < 1 and (elapsed < 2 or fraction < 0.01 or (fraction < _WARM_SHARE and elapsed < _WARM_SECONDS)):
            return None
        warm = min(elapsed / 2, _WARM_SECONDS)
        since, behind = next(one for one in reversed(self._warming) if one[0] <= warm)
        if behind >= fraction:
            since = behind = 0.0
        return (elapsed - since) * (1 - fraction) / max(fraction - behind, 1e-9)

    def _weighed(self, fraction: float) -> float:
        """Share of the run that is done, by the weights of its stages."""
        return (self.earlier + self.own * fraction) / max(self.earlier + self.own + self.later, 1e-9)

    def start_clock(self) -> None:
        """Start the clock for estimates of the time left; earlier checks and warm-up do not count."""
        self._clock = self.context.clock()
        self._warming = [(0.0, 0.0)]

    def part(self, label: str, start: float = 0.0, stop: float = 1.0) -> ProgressFn:
        """A progress callback for library functions, mapped to the range `start` to `stop` of this stage."""

        def report(done: int, total: int, **figures: JsonData) -> None:
            fraction = done / total if total else 0.0
            self.progress(start + (stop - start) * min(1.0, fraction), label, **figures)

        return report

    def _emit(self, event: Event) -> None:
        with self._lock:
            self.context.emit(event)

    def metrics(self, values: Mapping[str, JsonData], group: int | None = None, frame: int | None = None) -> None:
        """Report final figures of a frame, a group or the stage, by name."""
        self._emit(Metrics(stage=self.stage, values=values, group=group, frame=frame))

    def preview(self, path: Path, caption: str, **where: Any) -> None:
        """Report a preview image at `path`; `where`: other attributes of `Preview`."""
        self._emit(Preview(stage=self.stage, path=str(path), caption=caption, **where))

    def log(self, message: str) -> None:
        """Report a detail that is only shown in logs."""
        self._emit(Log(stage=self.stage, message=message))

    def warn(self, message: Message | str) -> None:
        """Report a warning. Plain text gets the code `STAGE.warning`."""
        if not isinstance(message, Message):
            message = Message(f"{self.stage}.warning", message)
        self._emit(Warned.of(message, stage=self.stage))


class Stage(Protocol):
    """A step from footage to stream. Stages read and write the take and call `studio`; they hold no state.

    Attributes:
        name: as in the take and on the command line.
        title: display name.
        version: raised whenever the format or meaning of its results changes; older results are then stale.
        weight: rough share of a run's time.
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
        """Settings and inputs that affect the results; the runner adds the results of `dependencies`."""
        ...

    def results(self, context: Context) -> list[Path]:
        """Files that the stage writes; later stages depend on their content."""
        ...

    def units(self, context: Context) -> tuple[int, int, str] | None:
        """Number of finished valid units, number of all units, their name ("frames"); None if it has no units."""
        ...

    def run(self, context: Context, reporter: StageReporter) -> Result:
        """Write the results; finished units are kept.

        Returns:
            the main figures: a model of `pipelines.stages.summaries`.

        Raises:
            StudioError: bad input.
            Cancelled: the run was cancelled.
        """
        ...


class GroupStage(Stage, Protocol):
    """A stage whose groups need nothing of each other, so that each can run in another process or on another machine.

    `run` then finds all groups finished and only puts the results together.
    """

    def group_key(self, context: Context, group: Group) -> str:
        """Digest of everything that the group's results are made from."""
        ...

    def group_done(self, context: Context, group: Group) -> bool:
        """Whether the group's results are there and up to date."""
        ...

    def run_group(self, context: Context, group: Group, reporter: StageReporter) -> None:
        """Make the group's results; goes on from the last finished frame or checkpoint.

        Raises:
            StudioError: bad input.
            Cancelled: the run was cancelled.
        """
        ...


class Executor(Protocol):
    """Runs groups of a stage somewhere else."""

    def run(
        self,
        stage: GroupStage,
        context: Context,
        groups: Sequence[Group],
        reporter: StageReporter,
        finished: Callable[[Group], None] = lambda group: None,
    ) -> None:
        """Run these groups; returns when the results of all are in the take.

        Args:
            stage: their stage.
            context: of the run.
            groups: those that are not up to date.
            reporter: gets progress, figures, previews and warnings as in a local run.
            finished: called after each group, in this thread.

        Raises:
            StudioError: a group failed; the others are cancelled.
            Cancelled: the run was cancelled.
        """
        ...


def leftover(folder: Path, wanted: Sequence[Path], pattern: str) -> list[Path]:
    """Entries of `folder` that match `pattern` and are not in `wanted`, such as those of an earlier, longer run."""
    return [path for path in sorted(folder.glob(pattern)) if path not in set(wanted)]
