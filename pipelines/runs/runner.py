"""Runs the stages of a take that are not up to date, and reports events."""

import contextlib
import json
import logging
import os
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from v3studio.pipelines.config import Config, load_config
from v3studio.pipelines.events import (
    Emit,
    Event,
    Log,
    Metrics,
    RunStarted,
    StageFailed,
    StageFinished,
    StageStarted,
    Warned,
    as_message,
)
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.events.event_log import EventLog
from v3studio.pipelines.reports.evaluation import update_marks
from v3studio.pipelines.runs.finishing import finishing
from v3studio.pipelines.runs.out_of_memory import memory_errors
from v3studio.pipelines.runs.staleness import DONE, StageStatus, assess_all, not_ready, write_record
from v3studio.pipelines.stages import STAGE_NAMES, STAGES, Executor, Stage, stage_named
from v3studio.pipelines.stages.evaluate import lpips_of
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import Countdown, StageReporter
from v3studio.pipelines.takes.cancel_request import cancelled_on_request
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.pipelines.takes.files.settings_file import save_config, set_settings
from v3studio.pipelines.takes.results.integrity import refuse_damage
from v3studio.pipelines.takes.results.kept_bakes import free_name, keep_bake, note_evaluation
from v3studio.pipelines.takes.results.records import RecordedWarning, StageRecord, read_record, write_failure
from v3studio.pipelines.takes.take import Take
from v3studio.pipelines.version import program_version
from v3studio.studio.atomic_files import remove, write_text
from v3studio.studio.errors import Cancelled, Message, StudioError, reason_of
from v3studio.studio.json_types import JsonData
from v3studio.studio.process import logged

_LOG = logging.getLogger(__name__)

_CHECKED = ("calibrate", "initialize")
"""Stages whose results are compared with their record before use; frames and streams are checked as they are read."""


def status(take: Take, settings: Config | Mapping[str, Any]) -> dict[str, StageStatus]:
    """The status of each stage under these settings (as for `run`), in order."""
    return assess_all(Inputs(take, _config(settings)))


def run(
    take: Take,
    settings: Config | Mapping[str, Any],
    on_event: Emit = lambda event: None,
    *,
    stages: str | Iterable[str] = STAGE_NAMES,
    force: bool = False,
    cancellation: Cancellation | None = None,
    command: str = "v3studio run",
    keep: str | None = None,
) -> Mapping[str, JsonData]:
    """Run the stages of a take that are not up to date.

    Example:
        >>> take = v3.Take.create("new-take")
        >>> figures = v3.run(take, {"capture.root": "footage", "initialize.points": 500}, stages="calibrate")
        >>> list(figures), v3.status(take, v3.load_config(take.config))["calibrate"].state
        (['calibrate'], 'done')

    Args:
        take: the take; locked during the run.
        settings: all settings, or values by dotted name of those that differ from the defaults; written to the take's
            config.yaml.
        on_event: receives the events; the last is always `Finished`.
        stages: a name or several. Stages that they depend on must be up to date or among them.
        force: run them from scratch even if they are up to date. Each earlier result stays until its new one is
            complete.
        cancellation: set it from another thread to cancel; SIGINT and SIGTERM set it too.
        command: recorded in the lock, for the error that a second run gets.
        keep: name under which the stream is kept at the end, before anything else can change it; None: it is not.

    Returns:
        The main figures of each stage that ran or was up to date, by its name, as in its record in the take.

    Raises:
        StudioError: bad input or settings, a second run (`take.locked`), a full disk (`take.disk_full`), a name in
            `stages` that is not a stage's (`stage.unknown`), a stage that is not up to date and not among them
            (`stage.dependency`), the stream cannot be kept (`bakes.*`).
        Cancelled: the run was cancelled.
    """
    cancellation = cancellation or Cancellation()
    config = _config(settings)
    report: Emit = on_event
    verified = set[str]()
    notices: list[Message] = []
    with (
        finishing(lambda: report, cancellation, "Run again to resume.", lambda: _result(take, verified)) as clock,
        disk_errors(take.root),
        take.locked(command, notices.append),
        cancelled_on_request(take, cancellation.cancel),
    ):
        names = _known(stages)
        write_text(take.log, "")
        report = EventLog(take.log, 2.0, on_event)
        for notice in notices:
            report(Warned.of(notice))
        if keep is not None:
            free_name(take, keep)
        # the log has just been written: whatever a forced stage writes is not older, by the clock of the same disk
        since = dict.fromkeys(names, take.log.stat().st_mtime_ns) if force else {}
        _Run(Inputs(take, config, since=since), report, cancellation, clock, force, verified).go(names)
        if keep is not None:
            kept = keep_bake(take, keep)
            report(Log(stage="bake", message=f"kept as '{kept.name}'"))
    return _figures(take, verified)


def _config(settings: Config | Mapping[str, Any]) -> Config:
    return settings if isinstance(settings, Config) else load_config(None, settings.items())


def _result(take: Take, verified: Collection[str]) -> Mapping[str, JsonData]:
    """The result of a run for programs."""
    return {"take": str(take.root), "stages": _figures(take, verified)}


def _figures(take: Take, verified: Collection[str]) -> dict[str, JsonData]:
    """The main figures of the stages that a run ran or found up to date. Stages that finished before a stage that they
    depend on, such as an evaluation of an earlier bake, are left out."""
    current: dict[str, StageRecord] = {}
    for name in STAGE_NAMES:
        record = read_record(take, name) if name in verified else None
        if record is not None and all(
            needed in current and record.params.get(f"result of {needed}") == current[needed].result
            for needed in stage_named(name).dependencies
        ):
            current[name] = record
    return {name: record.summary for name, record in current.items()}


def _known(stages: str | Iterable[str]) -> list[str]:
    """The named stages, in the order in which they run. Raises StudioError `stage.unknown`."""
    wanted = (stages,) if isinstance(stages, str) else tuple(stages)
    for name in wanted:
        if name not in STAGE_NAMES:
            fix = f"The stages are {', '.join(STAGE_NAMES)}."
            raise StudioError("stage.unknown", f"there is no stage named '{name}'", value=name, fix=fix)
    return [name for name in STAGE_NAMES if name in wanted]


class StageNotes:
    """Passes the events of a stage on, and keeps its warnings, and the groups that it made."""

    def __init__(self, emit: Emit) -> None:
        self._emit = emit
        self._warnings: list[RecordedWarning] = []
        self._groups: set[int] = set()

    def __call__(self, event: Event) -> None:
        if isinstance(event, Warned):
            values = json.loads(event.to_json())
            recorded = {name: values[name] for name in RecordedWarning.model_fields}
            self._warnings.append(RecordedWarning.model_validate(recorded))
        elif isinstance(event, Metrics) and event.group is not None:
            self._groups.add(event.group)
        self._emit(event)

    def with_kept(self, earlier: StageRecord | None) -> list[RecordedWarning]:
        """The warnings of the stage, with earlier ones about groups that were not made again."""
        kept = [warning for warning in (earlier.warnings if earlier else ()) if warning.group not in self._groups]
        new = {(warning.code, warning.group, warning.message) for warning in self._warnings}
        return [*(each for each in kept if (each.code, each.group, each.message) not in new), *self._warnings]


@dataclass
class _Run:
    """A run of a locked take. `clock`: work time in seconds; `verified`: stages that are up to date."""

    inputs: Inputs
    emit: Emit
    cancellation: Cancellation
    clock: Callable[[], float]
    force: bool
    verified: set[str]

    def go(self, names: Sequence[str]) -> None:
        inputs, started = self.inputs, self.clock()
        take, settings = inputs.take, inputs.config.run
        if not take.config.exists():
            save_config(take.config, inputs.config)
        # report unreadable footage and edits before anything else
        _ = inputs.raw_footage, inputs.footage_digest, inputs.edits
        before = assess_all(inputs)
        self.verified.update(name for name, status in before.items() if status.state == DONE)
        todo = [stage for stage in STAGES if stage.name in names and (self.force or before[stage.name].state != DONE)]
        for stage in todo:
            for dependency in stage.dependencies:
                if stage_named(dependency) not in todo and before[dependency].state != DONE:
                    raise not_ready(stage, before[dependency])
        # report a missing GPU, a cluster that does not answer and weights that cannot be loaded before hours of work
        if (
            settings.executor == "local"
            and settings.device not in ("auto", "cpu")
            and any(stage.renders for stage in todo)
        ):
            _ = inputs.device
        evaluates = stage_named("evaluate") in todo
        with _executor(inputs, todo) as executor:
            if evaluates:
                lpips_of(inputs.config, inputs.device if executor is None else "cpu")
            save_config(take.config, inputs.config)  # now that nothing refuses the settings
            self.emit(
                RunStarted(
                    take=str(take.root),
                    stages=tuple(stage.name for stage in todo),
                    done=tuple(
                        stage.name for stage in STAGES if stage not in todo and before[stage.name].state == DONE
                    ),
                    pid=os.getpid(),
                    version=program_version(),
                )
            )
            if todo:
                import torch

                torch.set_num_threads(inputs.threads)
                self._run_stages(todo, executor, started)
        if "evaluate" in names:
            if not evaluates:
                with contextlib.suppress(StudioError):
                    if update_marks(take, inputs.groups):
                        self.emit(Log(stage="evaluate", message="updated the marks in the report"))
            _note_evaluation(take, self.emit)

    def _run_stages(self, todo: Sequence[Stage], executor: Executor | None, started: float) -> None:
        reporter: StageReporter | None = None
        countdown, earlier = Countdown(), 0.0
        for position, stage in enumerate(todo):
            # earlier stages have run: if their results did not change, this one may be up to date after all
            now = assess_all(self.inputs, until=stage)[stage.name]
            if now.state == DONE and not self.force:
                self.verified.add(stage.name)
                continue
            reporter = StageReporter(
                stage.name,
                self.emit,
                self.cancellation,
                self.clock,
                own=stage.weight,
                later=sum(after.weight for after in todo[position + 1 :]),
                before=self.clock() - started,
                total_fraction=reporter.total_fraction if reporter else 0.0,
                earlier=earlier,
                run=countdown,
            )
            reason = "forced" if self.force and now.state == DONE else now.reason
            self._run_stage(stage, reporter, executor, reason)
            earlier += stage.weight

    def _run_stage(self, stage: Stage, reporter: StageReporter, executor: Executor | None, reason: str) -> None:
        inputs, started = self.inputs, self.clock()
        take = inputs.take
        self.cancellation.check()
        for dependency in stage.dependencies:
            if dependency in _CHECKED:
                refuse_damage(take, dependency)
        self.emit(StageStarted(stage=stage.name, reason=reason))
        remove(take.failure(stage.name))
        earlier = read_record(take, stage.name) if stage.by_group and not self.force else None
        notes = reporter.emit = StageNotes(self.emit)
        if self.force:
            remove(take.work(stage.name))
        try:
            with logged(_LOG, f"stage {stage.name} of {take.root}"), disk_errors(take.root), memory_errors(stage.name):
                summary = stage.code.run(inputs, reporter, executor)
                self.cancellation.check()
                seconds = self.clock() - started
                write_record(stage, inputs, seconds, summary, notes.with_kept(earlier))
                self.verified.add(stage.name)
        except Cancelled:
            raise
        except Exception as error:
            trace = "" if isinstance(error, StudioError) else traceback.format_exc()
            message = as_message(error)
            self.emit(StageFailed.of(message, stage=stage.name, traceback=trace))
            # on a full disk the record cannot be written either; the event and the exit code report the failure
            with contextlib.suppress(OSError):
                write_failure(take, stage.name, message)
                baked = read_record(take, "bake")
                if message.code == "bake.target_missed" and baked is not None:  # the take still has that stream
                    set_settings(take.config, {"bake.quality": baked.params["bake.quality"]})
            raise
        self.emit(StageFinished(stage=stage.name, seconds=round(seconds, 2), summary=summary.to_json()))


@contextlib.contextmanager
def _executor(inputs: Inputs, todo: Sequence[Stage]) -> Iterator[Executor | None]:
    """The executor that runs groups elsewhere, connected before anything is done; None if they run in this process."""
    if inputs.config.run.executor == "local" or not any(stage.by_group for stage in todo):
        yield None
        return
    from v3studio.pipelines.runs.cluster.connection import connected
    from v3studio.pipelines.runs.cluster.executor import RayExecutor

    with connected(inputs.config.run.address, inputs.threads) as ray:
        yield RayExecutor(ray)


def _note_evaluation(take: Take, emit: Emit) -> None:
    """Give the kept bake that was evaluated its evaluation, also if an earlier run was killed before it did."""
    try:
        note_evaluation(take)
    except (StudioError, OSError) as error:
        reason = error.message.problem if isinstance(error, StudioError) else reason_of(error)
        problem = f"the kept bake of this stream could not be given the evaluation ({reason})"
        fix = "Run `v3studio evaluate` again; nothing is measured again."
        message = Message("bakes.evaluation_not_noted", problem, take.bakes, fix=fix)
        emit(Warned.of(message, stage="evaluate"))
