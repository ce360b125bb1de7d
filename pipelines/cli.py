"""`v3studio ...`: the command line.

Exit codes: 0 success; 1 an error, reported as `error: ...` on stderr; 2 wrong usage; 130 cancelled (Ctrl-C, SIGTERM).
With `--json`, an error is also reported as the last line on stdout: the event `run_finished` with the outcome "failed"
and the error's code and fields.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from pipelines.commands.board import add_board_command, add_sync_command
from pipelines.commands.stored import working_copy
from pipelines.events.cancellation import EXIT_CANCELLED
from studio.environment import keep_freed_memory, passive_openmp
from studio.errors import Cancelled, StudioError
from studio.memory import require_memory
from studio.standard_output import as_utf8, claim_stdout, discard

if TYPE_CHECKING:
    from pipelines.config import Config
    from pipelines.takes.take import Take

STAGE_HELP = {
    "calibrate": "read the cameras from a file, or calibrate them",
    "initialize": "sample initial points on the visual hull of each keyframe",
    "train": "train the Gaussians",
    "bake": "encode the trained Gaussians as a stream",
    "evaluate": "measure the quality on held-out cameras and write the report",
}
GROUPS = {
    "Make a stream from footage": ("estimate", "run", "status", "attach", "queue", "config"),
    "Stages": tuple(STAGE_HELP),
    "Prepare a capture": ("board", "sync"),
    "Use streams and takes": ("play", "serve", "share", "publish", "export", "import"),
    "Use other machines": ("work",),
    "Keep takes": ("edit", "check", "bakes"),
    "Research": ("compare", "ablate"),
}
"""Commands in the order of `v3studio --help`."""

_EXAMPLES = """Examples:
    v3studio run sample_configs/quickstart.yaml --take takes/first
    v3studio run takes/first --bake.qp 24
    v3studio status takes/first
    v3studio export takes/first --format ply --out plys

Exit codes: 0 success, 1 error, 2 wrong usage, 130 cancelled.
`v3studio COMMAND --help` shows the options of a command.
"""
_SETTINGS_NOTE = """settings:
  --set SECTION.NAME=VALUE    or    --SECTION.NAME VALUE
  Overrides a setting; example: --train.max-splats 20000. `v3studio config` lists all settings.
"""


def main() -> int:
    """Run the command in `sys.argv` and return the exit code. If it is cancelled, the process exits immediately.

    Only the command's own output goes to stdout; that of native libraries, here or in child processes, goes to stderr.
    """
    passive_openmp()
    claim_stdout()
    code = execute(sys.argv[1:])
    if "--json" in sys.argv:
        sys.stdout = sys.stderr  # for anything printed while the process exits
    if code == EXIT_CANCELLED:
        # shutting down torch and its threads takes a while on a busy machine
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def execute(arguments: Sequence[str]) -> int:
    """Run a command in this process and return the exit code; wrong usage raises SystemExit(2)."""
    arguments = _current_stages(arguments)
    parser, commands = _parser()
    # errors in the arguments of a command show the usage of that command
    named = commands.get(arguments[0], parser) if arguments else parser
    plain = _long_settings_as_set(arguments, named)
    known, unknown = parser.parse_known_args(plain)
    if unknown:
        named.error(f"unrecognized arguments: {' '.join(unknown)}")
    try:
        known.overrides = _overrides(known)
        command: Callable[[argparse.Namespace], int] = known.command
        with _json_output() if getattr(known, "json", False) else nullcontext(sys.stdout) as known.output:
            try:
                with working_copy(known):
                    code = command(known)
            except StudioError as error:
                if getattr(known, "json", False) and not getattr(known, "reported", False):
                    _print_failure(error, known.output)
                raise
            known.output.flush()
        return code
    except StudioError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except (Cancelled, KeyboardInterrupt):
        return EXIT_CANCELLED
    except BrokenPipeError:  # `v3studio config | head`
        discard(sys.stdout)
        return 1


def _print_failure(error: StudioError, output: TextIO) -> None:
    """Print the last event of a command with `--json`."""
    from pipelines.events import RunFinished

    event = RunFinished.of(error.message, outcome="failed", seconds=0.0)
    with suppress(BrokenPipeError):
        print(event.to_json(), file=output, flush=True)


@contextmanager
def _json_output() -> Iterator[TextIO]:
    """Standard output, reserved for JSON: anything else that Python code prints in the block goes to stderr."""
    output = sys.stdout
    as_utf8(output)
    with redirect_stdout(sys.stderr):
        try:
            yield output
        finally:
            with suppress(BrokenPipeError):
                output.flush()


def _parser() -> tuple[argparse.ArgumentParser, dict[str, argparse.ArgumentParser]]:
    """The parser, and those of the commands by name."""
    from pipelines.commands import (
        ablate,
        attach,
        bakes,
        check,
        compare,
        edit,
        estimate,
        export,
        import_splats,
        play,
        publish,
        queue,
        serve,
        share,
        work,
    )
    from pipelines.version import program_version

    parser = _Parser(
        prog="v3studio",
        description="Turn synchronized multi-camera footage of a performer into a streamable Gaussian video.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"v3studio {program_version()}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    parser.commands = commands

    run = _stage_parser(commands, "run", "run all stages that are not up to date")
    run.add_argument(
        "--until",
        choices=list(STAGE_HELP),
        metavar="STAGE",
        help=f"stop after this stage: {', '.join(STAGE_HELP)}",
    )
    _add_live(run)
    _add_detach(run)
    run.set_defaults(command=_run, stage=None, stored_take="run")
    for name, text in STAGE_HELP.items():
        stage = _stage_parser(commands, name, text)
        stage.add_argument("--force", action="store_true", help="run from scratch even if it is up to date")
        if name == "bake":
            _add_targets(stage)
            _add_stream_options(stage)
            stage.add_argument("--keep", metavar="NAME", help="keep the bake under this name too; see `v3studio bakes`")
        if name == "train":
            _add_live(stage)
        _add_detach(stage)
        stage.set_defaults(command=_run, stage=name, until=None, stored_take="run")

    status = commands.add_parser(
        "status",
        help="show which stages of a take are up to date, and why others are not",
        description="Show which stages of a take are up to date, and why the others are not.",
        allow_abbrev=False,
    )
    status.add_argument("take", type=Path, metavar="DIR", help="folder or address of the take")
    status.add_argument("--json", action="store_true", help="print JSON")
    status.set_defaults(command=_status, stored_take="read")

    estimate.register(commands)
    attach.register(commands)
    queue.register(commands)
    work.register(commands)
    edit.register(commands)
    check.register(commands)
    bakes.register(commands)
    play.register(commands)
    serve.register(commands)
    share.register(commands)
    publish.register(commands)
    export.register(commands)
    import_splats.register(commands)
    compare.register(commands)
    ablate.register(commands)

    add_board_command(commands)
    add_sync_command(commands)

    config = commands.add_parser(
        "config",
        help="print all settings with their documentation",
        description="Print all settings with their documentation, as YAML that can be edited and used for a run.",
        epilog=_SETTINGS_NOTE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    config.add_argument(
        "config", type=Path, nargs="?", metavar="CONFIG", help="YAML file to take values from (default: the defaults)"
    )
    config.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE", help="override a setting")
    config.set_defaults(command=_config)
    return parser, dict(commands.choices)


class _Parser(argparse.ArgumentParser):
    """Adds clear errors for numbers, and help that lists commands by group. Subcommands use it too."""

    commands: Any = None
    """The subcommands; None except in the main parser."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.register("type", int, _integer)
        self.register("type", float, _number)

    def format_help(self) -> str:
        """Called by argparse. The main parser lists commands by group."""
        if self.commands is None:
            return super().format_help()
        summaries = {action.dest: action.help for action in self.commands._choices_actions}
        lines = ["usage: v3studio [--help] [--version] COMMAND ...", "", str(self.description), ""]
        for title, names in GROUPS.items():
            lines += [f"{title}:", *(f"    {name:<12}{summaries[name]}" for name in names), ""]
        lines += ["Options:", "    -h, --help  show this help", "    --version   show the version", "", _EXAMPLES]
        return "\n".join(lines)


def _integer(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not an integer; example: 24") from None


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number; example: 2.5")
    return value


class _Target(argparse.Action):
    """Sets one bake target and clears the other, which may be set in the take; the last option wins."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        """Called by argparse."""
        cleared = [f"bake.{name}=null" for name in ("target_kb_per_frame", "target_psnr") if name != self.const]
        namespace.set = [*namespace.set, *cleared, f"bake.{self.const}={values}"]


def _add_targets(stage: argparse.ArgumentParser) -> None:
    """Bake targets as options."""
    for name, metavar, text in (
        ("target_kb_per_frame", "KB", "choose each group's QP to stay within this many kilobytes per frame"),
        ("target_psnr", "DB", "choose each group's QP so that decoded renders reach this PSNR against trained ones"),
    ):
        stage.add_argument(f"--{name.replace('_', '-')}", action=_Target, const=name, metavar=metavar, help=text)


class _StreamVersion(argparse.Action):
    """Sets the version of the stream, and for `--ladder` the default ladder."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        """Called by argparse."""
        if self.const in ("ladder", "cut"):
            from studio.stream.settings import DEFAULT_LADDER

            cut = {"finetune_iterations": 0} if self.const == "cut" else {}
            rungs = json.dumps([{**rung.model_dump(mode="json"), **cut} for rung in DEFAULT_LADDER])
            targets = [f"bake.{name}=null" for name in ("target_kb_per_frame", "target_psnr")]
            namespace.set = [*namespace.set, *targets, "bake.stream_version=3", f"bake.ladder={rungs}"]
        else:
            without = ["bake.ladder=[]"] if values == "2" else []  # version 2 has one rendition
            namespace.set = [*namespace.set, *without, f"bake.stream_version={values}"]


def _add_stream_options(stage: argparse.ArgumentParser) -> None:
    """Version and ladder of the stream as options."""
    stage.add_argument(
        "--stream-version", action=_StreamVersion, choices=("2", "3"), help="version of the stream's format"
    )
    stage.add_argument(
        "--ladder",
        action=_StreamVersion,
        const="ladder",
        nargs=0,
        help="bake several renditions (version 3): QP 16, 20, 24, 28, and two with fewer splats and no view-dependent "
        "color for phones, which are fine-tuned; bake.ladder selects others",
    )
    stage.add_argument(
        "--ladder-without-fine-tuning",
        action=_StreamVersion,
        const="cut",
        nargs=0,
        help="like --ladder, but rungs with fewer splats are only cut: quicker and needs no images, but worse",
    )


class _Live(argparse.Action):
    """Sets `bake.live`."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        """Called by argparse."""
        namespace.set = [*namespace.set, "bake.stream_version=3", "bake.live=true"]


def _add_live(stage: argparse.ArgumentParser) -> None:
    stage.add_argument(
        "--live",
        action=_Live,
        nargs=0,
        help="bake and publish each group as soon as it is trained (bake.live); `v3studio serve` shows them meanwhile",
    )


def _add_detach(stage: argparse.ArgumentParser) -> None:
    stage.add_argument(
        "--detach",
        action="store_true",
        help="return at once; the run goes on, on the cluster if run.address is ray://. `v3studio attach` shows it",
    )


def _stage_parser(commands: Any, name: str, text: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=text,
        description=text[0].upper() + text[1:] + ".",
        epilog=_SETTINGS_NOTE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "config",
        type=Path,
        nargs="?",
        metavar="CONFIG",
        help="YAML file of settings, or the folder of a take (default: the settings in the take)",
    )
    parser.add_argument("--take", type=Path, metavar="DIR", help="folder or address of the take; created if needed")
    parser.add_argument("--json", action="store_true", help="print events as JSON lines instead of progress bars")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE", help="override a setting")
    return parser


def _long_settings_as_set(arguments: Sequence[str], parser: argparse.ArgumentParser) -> list[str]:
    """Rewrite `--section.name VALUE` and `--section.name=VALUE` as `--set section.name=VALUE`."""
    plain: list[str] = []
    words = iter(arguments)
    for word in words:
        name, equals, value = word.removeprefix("--").partition("=")
        if not word.startswith("--") or "." not in name:
            plain.append(word)
            continue
        if not equals:
            following = next(words, None)
            if following is None:
                parser.error(f"--{name} needs a value")
            value = following
        plain.append(f"--set={name}={value}")
    return plain


def _current_stages(arguments: Sequence[str]) -> list[str]:
    """Replace old names of stages, as the command and after `--until`."""
    words = list(arguments)
    if not words or words[0].startswith("-"):
        return words
    from pipelines.config.renamed import STAGES, note_renames

    for index, word in enumerate(words):
        option, equals, value = word.partition("=")
        if index == 0 or words[index - 1] == "--until":
            words[index] = STAGES.get(word, word)
        elif option == "--until" and equals:
            words[index] = f"{option}={STAGES.get(value, value)}"
        if words[index] != word:
            note_renames("command line", [f"{value or word} is now {words[index].removeprefix('--until=')}"])
    return words


def _overrides(arguments: argparse.Namespace) -> list[tuple[str, Any]]:
    given = getattr(arguments, "set", [])  # not every command has settings
    if not given:
        return []
    from pipelines.config.loading import parse_override

    return [parse_override(text) for text in given]


def _run(arguments: argparse.Namespace) -> int:
    require_memory()
    keep_freed_memory()
    from pipelines.config import load_config
    from pipelines.takes.atomic_files import disk_errors
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
        with disk_errors(arguments.take):
            take = Take.create(arguments.take)

    from pipelines.runs.console import Bars, JsonLines
    from pipelines.runs.runner import ALL_STAGES, run

    keep = getattr(arguments, "keep", None)
    if keep is not None:
        from pipelines.takes.kept_bakes import refuse_taken

        refuse_taken(take, keep)

    if arguments.stage:
        stages: Sequence[str] = (arguments.stage,)
    else:
        stages = ALL_STAGES[: ALL_STAGES.index(arguments.until) + 1] if arguments.until else ALL_STAGES
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
    stored = None if arguments.stored_run is None else arguments.stored_run.stored
    run = start_background(take, config, words, stored)
    place = str(arguments.take if stored is None else stored.address)
    if arguments.json:
        where = str(take.root) if stored is None else stored.address
        found = {"take": where, "pid": run.pid, "host": run.host, "running": run.code is None}
        print(json.dumps(found), file=arguments.output)
        return 0
    if run.code is not None:
        print(f"Everything is up to date (process {run.pid} on {run.host} has ended).", file=arguments.output)
        return 0
    print(f"The run goes on in the background (process {run.pid} on {run.host}).", file=arguments.output)
    print(f"Show it: v3studio attach {shlex.quote(place)}", file=arguments.output)
    return 0


def _status(arguments: argparse.Namespace) -> int:
    from pipelines.config import load_config
    from pipelines.takes.take import Take

    take = Take.open(arguments.take)
    config = load_config(take.config if take.config.is_file() else None, arguments.overrides)

    from pipelines.runs.status_table import print_status, status_json

    if arguments.json:
        print(status_json(take, config), file=arguments.output)
    else:
        print_status(take, config)
    return 0


def _config(arguments: argparse.Namespace) -> int:
    from pipelines.config import describe, load_config

    print(describe(load_config(arguments.config, arguments.overrides)), end="", file=arguments.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
