"""`v3studio run` and the stages one by one."""

from __future__ import annotations

import argparse
import shlex
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.commands.common.arguments import add_command, invalid_option
from v3studio.pipelines.commands.common.source import add_preset, add_source, is_take, read_settings
from v3studio.pipelines.reports.terminal import say
from v3studio.pipelines.stages import STAGE_NAMES, STAGES
from v3studio.studio.errors import StudioError
from v3studio.studio.memory import require_memory
from v3studio.studio.process import keep_freed_memory
from v3studio.studio.storage.address import is_address

if TYPE_CHECKING:
    from v3studio.pipelines.config import Config
    from v3studio.pipelines.takes.take import Take


def register(commands: Any) -> None:
    run = _stage_parser(commands, "run", "run all stages that are not up to date")
    run.add_argument(
        "--until", choices=STAGE_NAMES, metavar="STAGE", help=f"stop after this stage: {', '.join(STAGE_NAMES)}"
    )
    _add_live(run)
    for each in STAGES:
        name, stage = each.name, _stage_parser(commands, each.name, each.help)
        stage.add_argument("--force", action="store_true", help="run from scratch even if it is up to date")
        if name == "bake":
            stage.add_argument(
                "--ladder",
                action="store_const",
                const={},
                help="bake several renditions: QP 16, 20, 24, 28, and two with fewer splats and no view-dependent "
                "color for phones, which are fine-tuned; bake.ladder selects others",
            )
            stage.add_argument(
                "--ladder-without-fine-tuning",
                action="store_const",
                dest="ladder",
                const={"finetune_iterations": 0},
                help="like --ladder, but without fine-tuning: faster, needs no images, lower quality",
            )
            stage.add_argument("--keep", metavar="NAME", help="also keep the bake under this name")
        if name == "train":
            _add_live(stage)
        stage.set_defaults(stage=name)


def _add_live(stage: argparse.ArgumentParser) -> None:
    stage.add_argument(
        "--live",
        action="append_const",
        dest="set",
        const="run.live=true",
        help="bake and publish each group as soon as it is trained (run.live); `v3studio serve` shows them meanwhile",
    )


def _stage_parser(commands: Any, name: str, text: str) -> argparse.ArgumentParser:
    parser = add_command(commands, name, text, _run)
    parser.set_defaults(stage=None, until=None, force=False, keep=None, ladder=None)
    add_source(parser, nargs="?", note=" (default: the settings in the take)")
    parser.add_argument("--take", type=Path, metavar="TAKE", help="folder of the take; created if needed")
    add_preset(parser)
    parser.add_argument(
        "--detach",
        action="store_true",
        help="return at once; the run continues in the background, on the cluster if run.address is ray://; `v3studio "
        "status` shows it, and `v3studio cancel` stops it",
    )
    return parser


def _run(arguments: argparse.Namespace) -> None:
    require_memory()
    keep_freed_memory()
    from v3studio.pipelines.takes.files.disk_errors import disk_errors
    from v3studio.pipelines.takes.take import Take
    from v3studio.studio.footage import open_footage

    source, folder = arguments.source, arguments.take
    if source is not None and is_take(source):
        if folder is not None:
            fix = "Specify one take; for a new take with the same settings, name its config.yaml."
            raise invalid_option("--take", "is the folder of a take, but --take is specified too", fix, file=source)
        source, folder = None, source
    if folder is None and source is not None and not source.exists() and not is_address(source):
        fix = "Specify footage, a YAML file or a take, and --take DIR for a new take."
        raise StudioError("settings.file_not_found", "no such file or folder", file=source, fix=fix)
    if folder is None:
        fix = f"Example: v3studio run {'footage' if source is None else source} --take takes/first."
        raise StudioError("command.no_take", "no take is specified", fix=fix, option="--take")
    fresh = not is_take(folder)
    if fresh and source is None and all(name != "capture.root" for name, _ in arguments.overrides):
        Take.open(folder)  # says what is missing
    # validate settings and footage before creating the folder
    overrides = arguments.overrides
    if arguments.ladder is not None:
        from v3studio.studio.stream.settings import DEFAULT_LADDER

        rungs = [{**rung.model_dump(mode="json"), **arguments.ladder} for rung in DEFAULT_LADDER]
        overrides = [("bake.ladder", rungs), *overrides]
    config = read_settings(source, overrides, arguments.preset, folder)
    if fresh:
        open_footage(config.capture, None, strict=False).close()
    with disk_errors(folder):
        take = Take.create(folder)

    from v3studio.pipelines.runs.console import Bars
    from v3studio.pipelines.runs.runner import run

    if arguments.keep is not None:
        from v3studio.pipelines.takes.results.kept_bakes import free_name

        free_name(take, arguments.keep)

    upto = STAGE_NAMES[: STAGE_NAMES.index(arguments.until or STAGE_NAMES[-1]) + 1]
    stages = (arguments.stage,) if arguments.stage else upto
    if arguments.detach:
        _detach(arguments, take, config)
        return
    command = f"v3studio {arguments.stage or 'run'}"
    with nullcontext(arguments.emit) if arguments.json else Bars() as show:
        run(take, config, show, stages=stages, force=arguments.force, command=command, keep=arguments.keep)
    if not arguments.json and "evaluate" in stages:
        from v3studio.pipelines.reports.tables import print_evaluation

        print_evaluation(take)


def _detach(arguments: argparse.Namespace, take: Take, config: Config) -> None:
    from v3studio.pipelines.runs.background import start_background

    words = [arguments.stage or "run"]
    words += ["--until", arguments.until] if arguments.until else []
    words += ["--force"] if arguments.force else []
    words += ["--keep", arguments.keep] if arguments.keep else []
    run = start_background(take, config, words)
    arguments.result = {"take": str(take.root), "pid": run.pid, "host": run.host, "running": run.code is None}
    if arguments.json:
        return
    if run.code is not None:
        say(f"Everything is up to date (process {run.pid} on {run.host} has ended).")
        return
    place = shlex.quote(str(arguments.take))
    say(f"Running in the background (process {run.pid} on {run.host}).")
    say(f"Show it: v3studio status {place}")
    say(f"Stop it: v3studio cancel {place}")
