"""`v3studio check`: finds files of a take that were damaged on disk."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import Any

from studio.progress import ProgressFn


def register(commands: Any) -> None:
    """Add the command to the command line."""
    command = commands.add_parser(
        "check",
        help="find files of a take that were damaged on disk",
        description="Read all results of a take and compare them with the checksums that were recorded when they were "
        "written. Exit code 1 if a file is damaged, changed or missing.",
        allow_abbrev=False,
    )
    command.add_argument("take", type=Path, metavar="DIR", help="folder of the take")
    command.add_argument("--remove", action="store_true", help="delete damaged files, so that the next run makes them")
    command.add_argument("--json", action="store_true", help="print JSON")
    command.set_defaults(command=_check)


def _check(arguments: argparse.Namespace) -> int:
    from pipelines.commands.working import working
    from pipelines.runs.runner import ALL_STAGES
    from pipelines.takes.integrity import check_take
    from pipelines.takes.take import Take

    take = Take.open(arguments.take)
    report: ProgressFn
    with working("check", None) as report:
        found = check_take(take, ALL_STAGES, report)
    if arguments.remove and found.damage:
        with take.locked("v3studio check --remove"):
            for damage in found.damage:
                path = take.file(damage.file)
                # never a folder, and nothing outside of the take, whatever a record says
                if damage.file and path.is_file() and path.resolve().is_relative_to(take.root.resolve()):
                    path.unlink()
                take.forget(damage.stage)
    if arguments.json:
        print(found.model_dump_json(indent=1), file=arguments.output)
        return 1 if found.damage else 0
    for damage in found.damage:
        print(f"{damage.problem}: {damage.file or f'results of the stage {damage.stage}'}")
    print(f"{found.files} files checked ({found.bytes:,} bytes), {len(found.damage) or 'none'} damaged")
    if found.unchecked:
        print(f"not finished, so only partly checked: {', '.join(found.unchecked)}")
    if found.damage:
        name = shlex.quote(str(arguments.take))
        first = "" if arguments.remove else f"v3studio check {name} --remove && "
        print(f"To make them again: {first}v3studio run {name}")
    return 1 if found.damage else 0
