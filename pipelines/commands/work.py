"""`v3studio work`: one stage of one group, for clusters and render farms."""

import argparse
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from v3studio.pipelines.commands.common.arguments import add_command, add_settings, print_text
from v3studio.pipelines.stages import CHAIN, GROUP_STAGES
from v3studio.studio.errors import StudioError
from v3studio.studio.memory import require_memory

_FORMATS = ("plain", "sbatch", "deadline")
_NAMES = tuple(stage.name for stage in GROUP_STAGES)

_NOTE = "Then `v3studio run TAKE` puts the groups together, does what is missing, and evaluates.\n"


def register(commands: Any) -> None:
    text = "process one group of a take, or print the commands for all groups"
    more = (
        "Does nothing where the results are up to date, and continues from the last finished frame or checkpoint, so "
        "it can be started again anywhere that sees the take and the footage."
    )
    parser = add_command(commands, "work", text, _work, more, epilog=_NOTE)
    parser.add_argument("take", type=Path, metavar="TAKE", help="folder of the take; its cameras must be calibrated")
    parser.add_argument(
        "--stage",
        action="append",
        choices=_NAMES,
        metavar="STAGE",
        help=f"{', '.join(_NAMES)}; may be repeated (default: {', '.join(CHAIN)})",
    )
    parser.add_argument("--group", type=int, metavar="N", help="number of the group, counted from 0")
    parser.add_argument("--print-commands", action="store_true", help="print a command for each unfinished group")
    parser.add_argument(
        "--format",
        choices=_FORMATS,
        default="plain",
        help="what --print-commands prints: plain, a command per line for GNU parallel and OpenCue's cuecmd (default); "
        "deadline, the same for Deadline's CommandScript; sbatch, a batch file for Slurm",
    )
    add_settings(parser)


def _work(arguments: argparse.Namespace) -> None:
    require_memory()
    from v3studio.pipelines.config import load_config
    from v3studio.pipelines.takes.take import Take

    if (arguments.group is None) == (not arguments.print_commands):
        problem = "specify either --group or --print-commands"
        fix = "Example: v3studio work takes/first --group 0."
        raise StudioError("command.group_or_commands", problem, fix=fix, option="--group")
    take = Take.open(arguments.take)
    config = load_config(take.config, arguments.overrides)
    stages = tuple(arguments.stage or CHAIN)
    if arguments.print_commands:
        from v3studio.pipelines.runs.print_commands import printed_commands

        text = printed_commands(take, config, stages, arguments.format, arguments.set)
        arguments.result = {"text": text}
        print_text(arguments, text.rstrip())
        return

    from v3studio.pipelines.runs.console import Bars
    from v3studio.pipelines.runs.work import run_work

    with nullcontext(arguments.emit) if arguments.json else Bars() as show:
        run_work(take, config, stages, arguments.group, show)
