"""`v3studio run` and the stages one by one."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.commands.arguments import SETTINGS_NOTE
from pipelines.stages import STAGE_NAMES, STAGES
from studio.errors import StudioError
from studio.memory import require_memory
from studio.process import keep_freed_memory

if TYPE_CHECKING:
    from pipelines.config import Config
    from pipelines.takes.take import Take


def register(commands: Any) -> None:
    """Add the commands to the command line."""
    run = _stage_parser(commands, "run", "run all stages that are not up to date")
    run.add_argument(
        "--until",
        choices=STAGE_NAMES,
        metavar="STAGE",
        help=f"stop after this stage: {', '.join(STAGE_NAMES)}",
    )
    _add_live(run)
    _add_detach(run)
    run.set_defaults(command=_run, stage=None)
    for each in STAGES:
        name, stage = each.name, _stage_parser(commands, each.name, each.help)
        stage.add_argument("--force", action="store_true", help="run from scratch even if it is up to date")
        if name == "bake":
            _add_stream_options(stage)
            stage.add_argument("--keep", metavar="NAME", help="keep the bake under this name too; see `v3studio bakes`")
        if name == "train":
            _add_live(stage)
        _add_detach(stage)
        stage.set_defaults(command=_run, stage=name, until=None)


class _Ladder(argparse.Action):
    """Sets the default ladder."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        """Called by argparse."""
        from studio.stream.settings import DEFAULT_LADDER

        cut = {"finetune_iterations": 0} if self.const == "cut" else {}
        rungs = json.dumps([{**rung.model_dump(mode="json"), **cut} for rung in DEFAULT_LADDER])
        namespace.set = [*namespace.set, f"bake.ladder={rungs}"]


def _add_stream_options(stage: argparse.ArgumentParser) -> None:
    """The ladder of the stream as options."""
    stage.add_argument(
        "--ladder",
        action=_Ladder,
        const="ladder",
        nargs=0,
        help="bake several renditions: QP 16, 20, 24, 28, and two with fewer splats and no view-dependent "
        "color for phones, which are fine-tuned; bake.ladder selects others",
    )
    stage.add_argument(
        "--ladder-without-fine-tuning",
        action=_Ladder,
        const="cut",
        nargs=0,
        help="like --ladder, but rungs with fewer splats are only cut: quicker and needs no images, but worse",
    )


def _add_live(stage: argparse.ArgumentParser) -> None:
    stage.add_argument(
        "--live",
        action="append_const",
        dest="set",
        const="bake.live=true",
        help="bake and publish each group as soon as it is trained (bake.live); `v3studio serve` shows them meanwhile",
    )


def _add_detach(stage: argparse.ArgumentParser) -> None:
    stage.add_argument(
        "--detach",
        action="store_true",
        help="return at once; the run continues in the background, on the cluster if run.address is ray://; `v3studio "
        "status` shows it, and `v3studio cancel` stops it",
    )


def _stage_parser(commands: Any, name: str, text: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=text,
        description=text[0].upper() + text[1:] + ".",
        epilog=SETTINGS_NOTE,
    )
    parser.add_argument(
        "config",
        type=Path,
        nargs="?",
        metavar="CONFIG",
        help="YAML file of settings, or the folder of a take (default: the settings in the take)",
    )
    parser.add_argument("--take", type=Path, metavar="DIR", help="folder of the take; created if needed")
    parser.add_argument("--json", action="store_true", help="print events as JSON lines instead of progress bars")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE", help="override a setting")
    return parser


def _run(arguments: argparse.Namespace) -> int:
    require_memory()
    keep_freed_memory()
    from pipelines.config import load_config
    from pipelines.takes.atomic_files import disk_errors
    from pipelines.takes.drawn_masks import for_another_take
    from pipelines.takes.take import Take

    if arguments.take is None and arguments.config is not None and arguments.config.is_dir():
        arguments.config, arguments.take = None, arguments.config
    if arguments.take is None:
        if arguments.config is not None and not arguments.config.exists():
            raise StudioError(
                "settings.file_not_found",
                "no such file or folder",
                file=arguments.config,
                fix="Specify a YAML file and --take DIR.",
            )
        raise StudioError(
            "command.no_take", "no take is specified", fix="Example: --take takes/first.", option="--take"
        )
    if arguments.config is not None and arguments.config.is_dir():
        raise StudioError(
            "command.two_takes",
            "is a folder, but --take is specified too",
            file=arguments.config,
            fix="Specify a YAML file, or leave out one of the folders.",
            option="--take",
        )
    if arguments.config is None:
        take = Take.open(arguments.take)
        config = load_config(take.config, arguments.overrides)
    else:
        # validate settings before creating the folder
        config = load_config(arguments.config, arguments.overrides)
        config = for_another_take(config, arguments.config, arguments.take)
        with disk_errors(arguments.take):
            take = Take.create(arguments.take)

    from pipelines.runs.console import Bars, JsonLines
    from pipelines.runs.runner import run

    keep = getattr(arguments, "keep", None)
    if keep is not None:
        from pipelines.takes.kept_bakes import free_name

        free_name(take, keep)

    if arguments.stage:
        stages: Sequence[str] = (arguments.stage,)
    else:
        stages = STAGE_NAMES[: STAGE_NAMES.index(arguments.until) + 1] if arguments.until else STAGE_NAMES
    if arguments.detach:
        return _detach(arguments, take, config)
    with JsonLines(arguments.output) if arguments.json else Bars() as show:
        try:
            run(
                take,
                config,
                show,
                stages=stages,
                force=bool(arguments.stage and arguments.force),
                command=f"v3studio {arguments.stage or 'run'}",
                keep=keep,
            )
        finally:
            arguments.reported = isinstance(show, JsonLines) and show.finished
    if not arguments.json and "evaluate" in stages:
        from pipelines.reports.tables import print_evaluation

        print_evaluation(take)
    return 0


def _detach(arguments: argparse.Namespace, take: Take, config: Config) -> int:
    from pipelines.runs.background import start_background

    words = [arguments.stage or "run"]
    words += ["--until", arguments.until] if arguments.until else []
    words += ["--force"] if arguments.stage and arguments.force else []
    words += ["--keep", arguments.keep] if getattr(arguments, "keep", None) else []
    run = start_background(take, config, words)
    if arguments.json:
        found = {"take": str(take.root), "pid": run.pid, "host": run.host, "running": run.code is None}
        print(json.dumps(found), file=arguments.output)
        return 0
    if run.code is not None:
        print(f"Everything is up to date (process {run.pid} on {run.host} has ended).", file=arguments.output)
        return 0
    place = shlex.quote(str(arguments.take))
    print(f"Running in the background (process {run.pid} on {run.host}).", file=arguments.output)
    print(f"Show it: v3studio status {place}", file=arguments.output)
    print(f"Stop it: v3studio cancel {place}", file=arguments.output)
    return 0
