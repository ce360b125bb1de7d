"""`v3studio status`: which stages of a take are up to date."""

import argparse
from pathlib import Path
from typing import Any

from pipelines.commands.common.arguments import add_command


def register(commands: Any) -> None:
    text = "show which stages of a take are up to date, and why others are not"
    status = add_command(commands, "status", text, _status)
    status.add_argument("take", type=Path, metavar="TAKE", help="folder of the take")
    status.add_argument("--check", action="store_true", help="exit with 1 unless all stages are known to be up to date")


def _status(arguments: argparse.Namespace) -> int:
    from pipelines.config import load_config
    from pipelines.takes.take import Take

    take = Take.open(arguments.take)
    config = load_config(take.config if take.config.is_file() else None, arguments.overrides)

    from pipelines.runs.status import print_status, status_values

    arguments.result = status_values(take, config)
    if not arguments.json:
        print_status(take, config)
    done = all(stage["state"] == "done" and not stage["reason"] for stage in arguments.result["stages"].values())
    return 1 if arguments.check and not done else 0
