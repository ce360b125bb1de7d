"""`v3studio work` as a process: events from start to end, and cancellation by signals."""

from __future__ import annotations

import os
from collections.abc import Sequence

from pipelines.config import Config
from pipelines.events import Emit, RunFinished, RunStarted, StageFinished, StageStarted, as_message
from pipelines.events.cancellation import Cancellation, stop_on_signals
from pipelines.events.work_clock import counting_pauses
from pipelines.runs.work import work
from pipelines.stages import GROUP_STAGES
from pipelines.takes.take import Take
from pipelines.version import program_version
from studio.errors import Cancelled, Message

_STOPPED = Message("run.cancelled", "finished work is kept", fix="Start it again anywhere to go on.")


def run_work(take: Take, config: Config, stages: Sequence[str], group: int, emit: Emit) -> None:
    """Do the stages of a group and report events as a run does; see `pipelines.runs.work.work`.

    Raises:
        StudioError, Cancelled: from `work`.
    """
    cancellation = Cancellation()
    names = tuple(stage.name for stage in GROUP_STAGES if stage.name in stages)

    def finish(outcome: str, message: Message | None = None) -> None:
        seconds = round(clock() - started, 2)
        emit(
            RunFinished(outcome=outcome, seconds=seconds)
            if message is None
            else RunFinished.of(message, outcome=outcome, seconds=seconds)
        )

    with counting_pauses() as clock, stop_on_signals(cancellation, lambda: finish("cancelled", _STOPPED)):
        started = clock()
        emit(RunStarted(take=str(take.root), stages=names, done=(), pid=os.getpid(), version=program_version()))
        try:
            for name in names:
                began = clock()
                emit(StageStarted(stage=name, reason=f"group {group}"))
                done = work(take, config, (name,), group, emit, cancellation=cancellation, clock=clock)
                summary = {"group": group, "done": "now" if done else "before"}
                emit(StageFinished(stage=name, seconds=round(clock() - began, 2), summary=summary))
        except Cancelled:
            finish("cancelled", _STOPPED)
            raise
        except Exception as error:
            finish("failed", as_message(error))
            raise
        finish("done")
