"""Runs the stages of a take that are not up to date, and reports events."""

from __future__ import annotations

import contextlib
import os
import time
import traceback
from collections.abc import Iterable, Iterator

from pipelines.config import Config
from pipelines.events import (
    Emit,
    Event,
    Log,
    Progress,
    RunFinished,
    RunStarted,
    StageFailed,
    StageFinished,
    StageStarted,
    Warned,
    as_message,
)
from pipelines.events.cancellation import Cancellation, stop_on_signals
from pipelines.events.work_clock import counting_pauses
from pipelines.runs.out_of_memory import memory_errors
from pipelines.runs.staleness import DONE, StageStatus, assess, assess_all, write_record
from pipelines.runs.work import limit_threads
from pipelines.stages import GROUP_STAGES, STAGES, stage_named
from pipelines.stages.base import Context, Executor, Stage, StageReporter
from pipelines.stages.time_left import Countdown
from pipelines.takes.atomic_files import disk_errors, remove, write_text
from pipelines.takes.cancel_request import cancelled_on_request
from pipelines.takes.integrity import refuse_damage
from pipelines.takes.kept_bakes import keep_bake, note_evaluation, refuse_taken
from pipelines.takes.migration import migrate
from pipelines.takes.records import write_failure
from pipelines.takes.settings_file import save_config
from pipelines.takes.take import Take
from pipelines.version import program_version
from studio.errors import Cancelled, Message, StudioError, reason_of

_KEPT = Message("run.cancelled", "finished work is kept", fix="Run again to resume.")
_INTERRUPTED = Message(
    "run.cancelled", "the current step was interrupted; finished work is kept", fix="Run again to resume."
)
_CHECKED = ("calibrate", "initialize")
"""Stages whose results are compared with their record before use; frames and streams are checked as they are read."""
ALL_STAGES = tuple(stage.name for stage in STAGES)


def status(take: Take, config: Config) -> dict[str, StageStatus]:
    """The status of each stage under these settings, in order."""
    return assess_all(STAGES, Context(take, config))


def run(
    take: Take,
    config: Config,
    emit: Emit,
    *,
    stages: Iterable[str] = ALL_STAGES,
    force: bool = False,
    cancellation: Cancellation | None = None,
    command: str = "v3studio run",
    keep: str | None = None,
) -> None:
    """Run the stages of a take that are not up to date.

    Args:
        take: the take; locked during the run.
        config: all settings; written to the take's config.yaml.
        emit: receives the events; the last is always `RunFinished`.
        stages: names. Stages that they depend on must be up to date or among them.
        force: run them from scratch even if they are up to date.
        cancellation: set it from another thread to cancel; SIGINT and SIGTERM set it too.
        command: recorded in the lock, for the error that a second run gets.
        keep: name under which the stream is kept at the end, before anything else can change it; None: it is not.

    Raises:
        StudioError: bad input, a second run (`take.locked`), a full disk (`take.disk_full`), a stage that is not up to
            date and not among `stages` (`stage.dependency`), the stream cannot be kept (`bakes.*`).
        Cancelled: the run was cancelled.
    """
    cancellation = cancellation or Cancellation()
    names = [stage.name for stage in STAGES if stage.name in set(stages)]
    report = emit

    def finish(outcome: str, message: Message | None = None) -> None:
        seconds = round(clock() - started, 2)
        if message is None:
            report(RunFinished(outcome=outcome, seconds=seconds))
        else:
            report(RunFinished.of(message, outcome=outcome, seconds=seconds))

    with counting_pauses() as clock, stop_on_signals(cancellation, lambda: finish("cancelled", _INTERRUPTED)):
        started = clock()
        try:
            with (
                disk_errors(take.root),
                take.locked(command),
                cancelled_on_request(take, cancellation.cancel),
            ):
                migrate(take)
                report = Logged(emit, take)
                if keep is not None:
                    refuse_taken(take, keep)
                _run_locked(Context(take, config, report, cancellation, clock), names, force, started)
                if keep is not None:
                    kept = keep_bake(take, keep)
                    report(Log(stage="bake", message=f"kept as '{kept.name}'"))
        except Cancelled:
            finish("cancelled", _KEPT)
            raise
        except Exception as error:
            finish("failed", as_message(error))
            raise
        finish("done")


class Logged:
    """Forwards events and writes them to the take's log, replacing that of the previous run.

    Progress is logged at most every two seconds, to keep logs of long runs small.
    """

    def __init__(self, emit: Emit, take: Take) -> None:
        self._emit, self._path = emit, take.log
        self._last_progress = -2.0
        write_text(self._path, "")

    def __call__(self, event: Event) -> None:
        self._emit(event)
        if isinstance(event, Progress):
            if time.monotonic() - self._last_progress < 2:
                return
            self._last_progress = time.monotonic()
        # an unwritable log (a full disk) must not stop the event
        with contextlib.suppress(OSError), self._path.open("a", encoding="utf-8") as file:
            file.write(event.to_json() + "\n")


def _run_locked(context: Context, names: list[str], force: bool, run_started: float) -> None:
    save_config(context.take.config, context.config)
    # report unreadable footage and edits before anything else
    _ = context.footage.raw, context.footage.digest, context.edits
    found = assess_all(STAGES, context)
    todo = [name for name in names if force or found[name].state != DONE]
    _refuse_gaps(todo, found)
    context.emit(
        RunStarted(
            take=str(context.take.root),
            stages=tuple(todo),
            done=tuple(name for name, state in found.items() if state.state == DONE and name not in todo),
            pid=os.getpid(),
            version=program_version(),
        )
    )
    here = context.config.run.executor == "local"
    if here and {"train", "bake", "evaluate"} & set(todo) and context.config.run.device not in ("auto", "cpu"):
        _ = context.device  # report a missing GPU before hours of work
    if todo:
        limit_threads(context.threads)
        with _executor(context, todo) as context.executor:
            if "evaluate" in todo:
                _ = context.lpips  # report weights that cannot be loaded before hours of work, too
            _run_stages(context, todo, force, run_started)
    if "evaluate" in names and "evaluate" not in todo:
        _update_marks(context)
    if "evaluate" in names:
        _note_evaluation(context)


@contextlib.contextmanager
def _executor(context: Context, todo: list[str]) -> Iterator[Executor | None]:
    """What runs groups elsewhere, connected before anything is done; None if they run in this process."""
    if context.config.run.executor == "local" or not {stage.name for stage in GROUP_STAGES} & set(todo):
        yield None
        return
    from pipelines.runs.cluster.connection import connected
    from pipelines.runs.cluster.executor import RayExecutor

    with connected(context.config.run.address, context.threads) as ray:
        yield RayExecutor(ray)


def _run_stages(context: Context, todo: list[str], force: bool, run_started: float) -> None:
    weights = {name: stage_named(name).weight for name in todo}
    reporter: StageReporter | None = None
    countdown, earlier = Countdown(), 0.0
    for position, name in enumerate(todo):
        stage = stage_named(name)
        # earlier stages have run: if their results did not change, this one may be up to date after all
        now = assess(stage, context, assess_all(STAGES, context))
        if now.state == DONE and not force:
            continue
        reached = reporter.total_fraction if reporter else 0.0
        later = sum(weights[after] for after in todo[position + 1 :])
        before = context.clock() - run_started
        reporter = StageReporter(name, context, weights[name], later, before, reached, earlier, countdown)
        _run_stage(stage, context, reporter, "forced" if force and now.state == DONE else now.reason, force)
        earlier += weights[name]


def _update_marks(context: Context) -> None:
    """Update the marks in the report; a report of an earlier version, which has none, is left unchanged."""
    from pipelines.reports.evaluation import update_marks

    with contextlib.suppress(StudioError):
        if update_marks(context.take, context.groups):
            context.emit(Log(stage="evaluate", message="updated the marks in the report"))


def _note_evaluation(context: Context) -> None:
    """Give the kept bake that was evaluated its evaluation, also if an earlier run was killed before it did."""
    try:
        note_evaluation(context.take)
    except (StudioError, OSError) as error:
        problem = error.message.problem if isinstance(error, StudioError) else reason_of(error)
        message = Message(
            "bakes.evaluation_not_noted",
            f"the kept bake of this stream could not be given the evaluation ({problem})",
            context.take.bakes,
            fix="Run `v3studio evaluate` again; nothing is measured anew.",
        )
        context.emit(Warned.of(message, stage="evaluate"))


def _refuse_gaps(todo: list[str], found: dict[str, StageStatus]) -> None:
    for name in todo:
        for dependency in stage_named(name).dependencies:
            if dependency not in todo and found[dependency].state != DONE:
                status, reason = found[dependency].state, found[dependency].reason
                raise StudioError(
                    "stage.dependency",
                    f"the stage {name} needs {dependency}, which is {status}{f' ({reason})' if reason else ''}",
                    fix=f"Run `v3studio {dependency}` first, or `v3studio run` for all stages.",
                    stage=name,
                    dependency=dependency,
                    state=status,
                    reason=reason,
                )


def _run_stage(stage: Stage, context: Context, reporter: StageReporter, reason: str, force: bool) -> None:
    started = context.clock()
    context.cancellation.check()
    for dependency in stage.dependencies:
        if dependency in _CHECKED:
            refuse_damage(context.take, dependency)
    context.emit(StageStarted(stage=stage.name, reason=reason))
    context.take.forget(stage.name)
    if force:
        remove(context.take.work(stage.name))
        for path in stage.results(context):
            remove(path)
    try:
        with disk_errors(context.take.root), memory_errors(stage.name):
            summary = stage.run(context, reporter)
            context.cancellation.check()
            seconds = context.clock() - started
            write_record(stage, context, seconds, summary)
    except Cancelled:
        raise
    except Exception as error:
        trace = "" if isinstance(error, StudioError) else traceback.format_exc()
        message = as_message(error)
        context.emit(StageFailed.of(message, stage=stage.name, traceback=trace))
        _try_to_note_failure(context, stage.name, message)
        raise
    context.emit(StageFinished(stage=stage.name, seconds=round(seconds, 2), summary=summary.to_json()))


def _try_to_note_failure(context: Context, stage: str, message: Message) -> None:
    # on a full disk the record cannot be written either; the event and the exit code report the failure
    with contextlib.suppress(OSError):
        write_failure(context.take, stage, message)
