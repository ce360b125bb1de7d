"""Progress and cancellation for long commands other than runs of a take."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from pipelines.events.cancellation import Cancellation, stop_on_signals
from studio.progress import ProgressFn

_JSON_SECONDS = 0.2  # between lines


@contextmanager
def working(what: str, json_output: TextIO | None) -> Iterator[ProgressFn]:
    """A `ProgressFn` that shows a progress bar or prints JSON lines, and raises Cancelled after Ctrl-C.

    Args:
        what: label of the bar.
        json_output: print `{"kind": "progress", "what", "done", "total"}` lines to this stream instead.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from pipelines.reports.terminal import console

    cancellation = Cancellation()
    screen = console()
    bars = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=28),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=screen,
        transient=True,
        disable=json_output is not None or not screen.is_terminal,
    )
    printed = 0.0

    def progress(done: int, total: int, **figures: Any) -> None:
        nonlocal printed
        cancellation.check()
        bars.update(task, completed=done, total=total)
        if json_output is not None and (done >= total or time.monotonic() - printed > _JSON_SECONDS):
            printed = time.monotonic()
            line = json.dumps({"kind": "progress", "what": what, "done": done, "total": total})
            print(line, file=json_output, flush=True)

    with stop_on_signals(cancellation, screen.file.flush), bars:
        task = bars.add_task(what, total=None)
        yield progress
