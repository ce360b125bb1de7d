"""`v3studio status`: which stages of a take are up to date."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def register(commands: Any) -> None:
    """Add the command to the command line."""
    status = commands.add_parser(
        "status",
        help="show which stages of a take are up to date, and why others are not",
        description="Show which stages of a take are up to date, and why the others are not.",
    )
    status.add_argument("take", type=Path, metavar="DIR", help="folder of the take")
    status.add_argument("--json", action="store_true", help="print JSON")
    status.set_defaults(command=_status)


def _status(arguments: argparse.Namespace) -> int:
    from pipelines.config import load_config
    from pipelines.takes.take import Take

    take = Take.open(arguments.take)
    config = load_config(take.config if take.config.is_file() else None, arguments.overrides)

    from pipelines.runs.status import print_status, status_json

    if arguments.json:
        print(status_json(take, config), file=arguments.output)
    else:
        print_status(take, config)
    return 0
