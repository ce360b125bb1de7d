"""The check of a take's footage, beside the training of its first frames."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.studio.errors import Cancelled, Message, StudioError

if TYPE_CHECKING:
    from v3studio.studio.footage import Footage


@contextmanager
def footage_check(
    footage: Footage, frames: tuple[int, ...], stop: Cancellation, reporter: StageReporter
) -> Iterator[None]:
    """Check frames in a thread while the block trains; the block's end waits for the check, which sets `stop` to end
    the training when it finds problems, and warns of each camera whose exposure or white balance changes.

    StudioError if a frame cannot be read or has an empty mask. It names all problems, also if the block failed first
    with one of them.
    """
    from v3studio.studio.footage import check_footage
    from v3studio.studio.footage.checks import ColorDrift

    ended, drift, trained = Cancellation(), ColorDrift(), False
    counting = reporter.counting("checking the footage: image")

    def report(done: int, total: int, **figures: Any) -> None:
        reporter.check()
        ended.check()
        if trained:  # the stage waits for it
            counting(done, total)

    def check() -> list[Message]:
        try:
            problems = check_footage(footage, report, frames=frames, drift=drift)
        except Cancelled:
            return []
        except BaseException:
            stop.cancel()
            raise
        for message in drift.messages():
            reporter.warn(message)
        if problems:
            stop.cancel()
        return problems

    with ThreadPoolExecutor(1, thread_name_prefix="check") as pool:
        checking = pool.submit(check)
        try:
            yield
            trained = True
        except BaseException as error:
            refused = isinstance(error, StudioError)
            if not refused:  # else the other problems are wanted
                ended.cancel()
            failed = checking.exception() is not None
            if (failed and refused) or not (failed or checking.result()):
                raise
    reporter.check()
    problems = checking.result()
    if problems:
        first = problems[0]
        raise StudioError(
            first.code,
            "\n".join(str(problem) for problem in problems),
            **{**first.fields, "count": len(problems), "codes": [problem.code for problem in problems]},
        )
