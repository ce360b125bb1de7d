"""The end of a run: it is reported in every case, also if signals stop it."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from v3studio.pipelines.events import Emit, Finished, as_message
from v3studio.pipelines.events.cancellation import Cancellation, stop_on_signals
from v3studio.pipelines.events.work_clock import WorkClock
from v3studio.studio.errors import Cancelled, Message
from v3studio.studio.json_types import JsonData

_KEPT = "finished work is kept"


@contextmanager
def finishing(
    emit: Callable[[], Emit],
    cancellation: Cancellation,
    again: str,
    result: Callable[[], Mapping[str, JsonData]] = dict,
) -> Iterator[WorkClock]:
    """Emits `Finished` at the end of the block, which SIGINT and SIGTERM cancel; yields a clock of work time."""

    def finish(outcome: str, message: Message | None = None) -> None:
        emit()(Finished.of(message, outcome=outcome, seconds=round(clock() - started, 2), result=result()))

    interrupted = Message("run.cancelled", f"the current step was interrupted; {_KEPT}", fix=again)
    with stop_on_signals(cancellation, lambda: finish("cancelled", interrupted)) as clock:
        started = clock()
        try:
            yield clock
        except Cancelled:
            finish("cancelled", Message("run.cancelled", _KEPT, fix=again))
            raise
        except Exception as error:
            finish("failed", as_message(error))
            raise
        finish("done")
