"""`v3studio attach`: shows a run that goes on elsewhere."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any


def register(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "attach",
        help="show the run in progress on a take, wherever it was started",
        description="Show the run in progress on a take, wherever it was started. Ctrl-C ends only the display.",
        allow_abbrev=False,
    )
    parser.add_argument("take", type=Path, metavar="DIR", help="folder or address of the take")
    parser.add_argument("--cancel", action="store_true", help="stop the run; finished work is kept")
    parser.add_argument("--json", action="store_true", help="print events as JSON lines instead of progress bars")
    parser.set_defaults(command=_attach, stored_take="attach")


def _attach(arguments: argparse.Namespace) -> int:
    from pipelines.runs.attach import attach
    from pipelines.runs.console import Bars, JsonLines
    from pipelines.takes.cancel_request import request_cancel
    from pipelines.takes.take import Take
    from studio.errors import Cancelled

    take = Take.open(arguments.take)
    if arguments.cancel and take.running() is not None:
        if arguments.stored_run is not None and take.lock_holder() is None:
            arguments.stored_run.request_cancel()
        else:
            request_cancel(take)
    with JsonLines(arguments.output) if arguments.json else Bars() as show:
        try:
            attach(take, show)
        except KeyboardInterrupt:
            print("The run goes on.", file=sys.stderr)
        except Cancelled:
            if not arguments.cancel:
                raise
        finally:
            arguments.reported = isinstance(show, JsonLines) and show.finished
    return 0
