"""Progress and cancellation for long commands other than runs of a take."""

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from v3studio.pipelines.events import Log, Progress
from v3studio.pipelines.events.cancellation import Cancellation, stop_on_signals
from v3studio.pipelines.reports.terminal import console, say
from v3studio.studio.progress import ProgressFn

_JSON_SECONDS = 0.2  # between lines


def say_note(arguments: argparse.Namespace, text: str) -> None:
    """Print what a command's user should know: a line, or with `--json` the event `Log`."""
    if arguments.json:
        arguments.emit(Log(message=text))
    else:
        say(f"note: {text}")


@contextmanager
def working(what: str, arguments: argparse.Namespace) -> Iterator[ProgressFn]:
    """A `ProgressFn` that shows a progress bar or, with `--json`, prints lines, and raises Cancelled after Ctrl-C."""
    from rich import progress as rich

    cancellation = Cancellation()
    screen = console()
    bars = rich.Progress(
        rich.TextColumn("{task.description}", markup=False),
        rich.BarColumn(bar_width=28),
        rich.MofNCompleteColumn(),
        rich.TimeRemainingColumn(),
        console=screen,
        transient=True,
        disable=arguments.json or not screen.is_terminal,
    )
    printed = 0.0

    def progress(done: int, total: int, **figures: Any) -> None:
        nonlocal printed
        cancellation.check()
        bars.update(task, completed=done, total=total)
        if arguments.json and (done >= total or time.monotonic() - printed > _JSON_SECONDS):
            printed = time.monotonic()
            part, figures = done / total if total else 0.0, {"done": done, "total": total}
            arguments.emit(Progress(fraction=part, total_fraction=part, label=what, figures=figures))

    with stop_on_signals(cancellation, screen.file.flush), bars:
        task = bars.add_task(what, total=None)
        yield progress
