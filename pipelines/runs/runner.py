"""Which stages must run, in what order; running them; stopping; telling what happens."""

from __future__ import annotations

import contextlib
import os
import time
import traceback
from collections.abc import Iterable

from pipelines.config import Config, dump_config
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
)
from pipelines.events.cancellation import Cancellation, stop_on_signals
from pipelines.events.work_clock import counting_pauses
from pipelines.runs.staleness import DONE, StageStatus, assess, assess_all, write_record
from pipelines.stages import STAGES, stage_named
from pipelines.stages.base import Context, Stage, StageReporter
from pipelines.takes.atomic_files import disk_errors, remove, write_text
from pipelines.takes.migration import migrate
from pipelines.takes.records import write_failure
from pipelines.takes.take import Take, program_version
from studio.errors import Cancelled, StudioError

_CUT_SHORT = "the step under way was cut short, what was finished before it is kept; run again to go on"
ALL_STAGES = tuple(stage.name for stage in STAGES)


def status(take: Take, config: Config) -> dict[str, StageStatus]:
    """How each stage of the take stands under these settings, in order."""
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
) -> None:
    """Bring stages of a take up to date; what is up to date already is left alone.

    Args:
        take: the take; locked while this runs.
        config: all settings; written to the take's config.yaml.
        emit: receives the events, `RunFinished` last, whatever happens.
        stages: names; stages that these need must be up to date or be among them.
        force: run them even if they are up to date, from their beginning.
        cancellation: set it from another thread to stop; SIGINT and SIGTERM set it too.
        command: who holds the take, for the message that a second run gets.

    Raises:
        StudioError: bad input, a second run, a full disk.
        Cancelled: asked to stop.
    """
    cancellation = cancellation or Cancellation()
    names = [stage.name for stage in STAGES if stage.name in set(stages)]
    tell = emit

    def finish(outcome: str, message: str = "") -> None:
        tell(RunFinished(outcome=outcome, seconds=round(clock() - started, 2), message=message))

    with counting_pauses() as clock, stop_on_signals(cancellation, lambda: finish("cancelled", _CUT_SHORT)):
        started = clock()
        try:
            with disk_errors(take.root), take.locked(command):
                migrate(take)
                tell = Logged(emit, take)
                _run_locked(Context(take, config, tell, cancellation, clock), names, force, started)
        except Cancelled:
            finish("cancelled", "what is finished is kept; run again to go on")
            raise
        except Exception as error:
            finish("failed", str(error) if isinstance(error, StudioError) else f"{type(error).__name__}: {error}")
            raise
        finish("done")


class Logged:
    """Passes events on and writes them to the take's log, a JSON object a line; the log of the run before is replaced.

    Progress is written every two seconds only, or the log of a long run would fill the disk.
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
        # a log that cannot be written (a full disk) must not hide what the event tells
        with contextlib.suppress(OSError), self._path.open("a", encoding="utf-8") as file:
            file.write(event.to_json() + "\n")


def _run_locked(context: Context, names: list[str], force: bool, run_started: float) -> None:
    write_text(context.take.config, dump_config(context.config))
    _ = context.footage.raw, context.footage.digest  # footage that cannot be read is told before anything else
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
    if {"train", "bake", "evaluate"} & set(todo) and context.config.run.device not in ("auto", "cpu"):
        _ = context.device  # a GPU that is not there is told before the hours of work that come first
    if "evaluate" in todo:
        _ = context.lpips  # nor is a metric that cannot be loaded found out at the very end
    _limit_threads(context.threads)
    weights = {name: stage_named(name).weight for name in todo}
    reporter: StageReporter | None = None
    for position, name in enumerate(todo):
        stage = stage_named(name)
        # stages before this one have run by now: what looked stale may be up to date after all
        now = assess(stage, context, assess_all(STAGES, context))
        if now.state == DONE and not force:
            continue
        reached = reporter.total_fraction if reporter else 0.0
        later = sum(weights[after] for after in todo[position + 1 :])
        reporter = StageReporter(name, context, weights[name], later, context.clock() - run_started, reached)
        _run_stage(stage, context, reporter, "asked for" if force and now.state == DONE else now.reason, force)
    if "evaluate" in names and "evaluate" not in todo:
        _update_marks(context)


def _update_marks(context: Context) -> None:
    """What was marked since the report was written; a report that has no place for marks stays as it is."""
    from pipelines.reports.evaluation import update_marks

    with contextlib.suppress(StudioError):
        if update_marks(context.take, context.groups):
            context.emit(Log(stage="evaluate", message="the report's marks are those of marks.json again"))


def _refuse_gaps(todo: list[str], found: dict[str, StageStatus]) -> None:
    for name in todo:
        for dependency in stage_named(name).dependencies:
            if dependency not in todo and found[dependency].state != DONE:
                raise StudioError(
                    f"The stage {name} needs {dependency}, which is {found[dependency].state}"
                    f"{f' ({found[dependency].reason})' if found[dependency].reason else ''}; "
                    f"run `v3studio {dependency}` first, or `v3studio run` for all that is needed."
                )


def _run_stage(stage: Stage, context: Context, reporter: StageReporter, reason: str, force: bool) -> None:
    started = context.clock()
    context.cancellation.check()
    context.emit(StageStarted(stage=stage.name, reason=reason))
    context.take.forget(stage.name)
    if force:
        remove(context.take.work(stage.name))
        for path in stage.results(context):
            remove(path)
    try:
        with disk_errors(context.take.root):
            summary = stage.run(context, reporter)
            context.cancellation.check()
            seconds = context.clock() - started
            write_record(stage, context, seconds, summary)
    except Cancelled:
        raise
    except Exception as error:
        ours = not isinstance(error, StudioError)
        message = f"{type(error).__name__}: {error}" if ours else str(error)
        context.emit(StageFailed(stage=stage.name, message=message, traceback=traceback.format_exc() if ours else ""))
        _try_to_note_failure(context, stage.name, message)
        raise
    context.emit(StageFinished(stage=stage.name, seconds=round(seconds, 2), summary=summary))


def _try_to_note_failure(context: Context, stage: str, message: str) -> None:
    # a full disk has no room for the note either; the event and the exit code tell
    with contextlib.suppress(OSError):
        write_failure(context.take, stage, message)


def _limit_threads(threads: int) -> None:
    import torch

    torch.set_num_threads(threads)
