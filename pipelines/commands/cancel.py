"""`v3studio cancel`: stops the run in progress on a take, on whichever machine it is."""

import argparse
import time
from pathlib import Path
from typing import Any

from pipelines.commands.common.arguments import add_command, print_text

_STOP_SECONDS = 60.0  # How long a run may take to stop. A network file system may show a request seconds late


def register(commands: Any) -> None:
    text = "stop the run in progress on a take, on any machine"
    parser = add_command(commands, "cancel", text, _cancel, "Finished work is kept.")
    parser.add_argument("take", type=Path, metavar="TAKE", help="folder of the take")


def _cancel(arguments: argparse.Namespace) -> int:
    from pipelines.takes.cancel_request import request_cancel
    from pipelines.takes.take import Take
    from studio.errors import StudioError

    take = Take.open(arguments.take)
    holder = take.running()
    if holder is None:
        problem = "no run is in progress"
        raise StudioError("take.no_run", problem, file=take.root, fix="`v3studio status` shows the results.")
    request_cancel(take)
    until = time.monotonic() + _STOP_SECONDS
    while (now := take.running()) is not None and now.get("pid") == holder.get("pid", now.get("pid")):
        if time.monotonic() > until:
            problem = f"process {now.get('pid')} on {now.get('host')} was asked to stop, but is still running"
            fix = "Look at it on that machine; a paused run stops when it is resumed."
            raise StudioError("run.not_stopped", problem, file=take.root, fix=fix)
        time.sleep(0.2)
    arguments.result = {"take": str(take.root), "pid": holder.get("pid"), "host": holder.get("host")}
    print_text(arguments, "The run was stopped.")
    return 0
