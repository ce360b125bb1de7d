"""`v3studio status` and `cancel`: which stages of a take are up to date, and the run in progress."""

import argparse
import time
from pathlib import Path
from typing import Any

from v3studio.pipelines.commands.common.arguments import add_command, print_text
from v3studio.studio.errors import StudioError

_STOP_SECONDS = 60.0  # How long a run may take to stop. A network file system may show a request seconds late


def register(commands: Any) -> None:
    text = "show which stages of a take are up to date, and why others are not"
    status = add_command(commands, "status", text, _status)
    status.add_argument("take", type=Path, metavar="TAKE", help="folder of the take")
    status.add_argument("--check", action="store_true", help="exit with 1 unless all stages are known to be up to date")

    text = "stop the run in progress on a take, on any machine"
    parser = add_command(commands, "cancel", text, _cancel, "Finished work is kept.")
    parser.add_argument("take", type=Path, metavar="TAKE", help="folder of the take")


def _status(arguments: argparse.Namespace) -> int:
    from v3studio.pipelines.config import load_config
    from v3studio.pipelines.runs.status import print_status, status_values
    from v3studio.pipelines.takes.take import Take

    take = Take.open(arguments.take)
    config = load_config(take.config if take.config.is_file() else None, arguments.overrides)
    arguments.result = status_values(take, config)
    if not arguments.json:
        print_status(take, config)
    done = all(stage["state"] == "done" and not stage["reason"] for stage in arguments.result["stages"].values())
    return 1 if arguments.check and not done else 0


def _cancel(arguments: argparse.Namespace) -> None:
    from v3studio.pipelines.takes.cancel_request import request_cancel
    from v3studio.pipelines.takes.take import Take

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
