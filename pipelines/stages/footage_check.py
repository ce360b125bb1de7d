"""The check of a take's footage, beside the training of its first frames."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from pipelines.events.cancellation import Cancellation
from pipelines.stages.reporter import StageReporter
from studio.errors import Cancelled, Message, StudioError

if TYPE_CHECKING:
    from studio.capture import Footage


@contextmanager
def footage_check(
    footage: Footage, frames: tuple[int, ...], stop: Cancellation, reporter: StageReporter
) -> Iterator[None]:
    """Check frames in a thread while the block trains; the block's end waits for the check, which sets `stop` to end
    the training when it finds problems, and warns of each camera whose exposure or white balance changes.

    StudioError if a frame cannot be read or has an empty mask. It names all problems, also if the block failed first
    with one of them.
    """
    from studio.capture import check_footage
    from studio.capture.checks import ColorDrift

    ended, drift = Cancellation(), ColorDrift()
    problems: list[Message] = []
    failures: list[BaseException] = []

    def report(done: int, total: int, **figures: Any) -> None:
        reporter.check()
        ended.check()

    def check() -> None:
        try:
            problems.extend(check_footage(footage, report, frames=frames, drift=drift))
        except Cancelled:
            pass
        except BaseException as error:
            failures.append(error)
        else:
            for message in drift.messages():
                reporter.warn(message)
        if problems or failures:
            stop.cancel()

    thread = threading.Thread(target=check, name="check")
    thread.start()
    try:
        yield
    except StudioError:
        thread.join()  # for the other problems
        if not problems:
            raise
    except BaseException:
        if not (problems or failures):
            ended.cancel()
            thread.join()
            raise
    thread.join()
    reporter.check()
    if failures:
        raise failures[0]
    if problems:
        first = problems[0]
        raise StudioError(
            first.code,
            "\n".join(str(problem) for problem in problems),
            **{**first.fields, "count": len(problems), "codes": [problem.code for problem in problems]},
        )
