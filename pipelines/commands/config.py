"""`v3studio config`: all settings with their documentation."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pipelines.commands.arguments import SETTINGS_NOTE


def register(commands: Any) -> None:
    """Add the command to the command line."""
    config = commands.add_parser(
        "config",
        help="print all settings with their documentation",
        description="Print all settings with their documentation, as YAML that can be edited and used for a run.",
        epilog=SETTINGS_NOTE,
    )
    config.add_argument(
        "config", type=Path, nargs="?", metavar="CONFIG", help="YAML file to take values from (default: the defaults)"
    )
    config.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE", help="override a setting")
    config.set_defaults(command=_config)


def _config(arguments: argparse.Namespace) -> int:
    from pipelines.config import describe, load_config

    print(describe(load_config(arguments.config, arguments.overrides)), end="", file=arguments.output)
    return 0
