"""`v3studio ...`: the command line.

Exit codes: 0 done, 1 bad input or a failure (one sentence on stderr), 2 wrong usage, 130 stopped.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from pathlib import Path
from typing import Any, TextIO

from pipelines.commands.board import add_board_command, add_sync_command
from pipelines.events.cancellation import EXIT_CANCELLED
from studio.errors import Cancelled, StudioError
from studio.standard_output import as_utf8, claim_stdout, discard

STAGE_HELP = {
    "calibrate": "find the cameras: from the capture's calibration, else from the footage",
    "initialize": "carve the visual hull of each group's keyframe and sample points on it",
    "train": "train the Gaussians, frame after frame",
    "bake": "write the stream",
    "evaluate": "decode the stream, compare with held-out cameras, write evaluation.json and report.html",
}
_SETTINGS_NOTE = """settings:
  --set SECTION.NAME=VALUE    or    --SECTION.NAME VALUE
  overrides a setting of the configuration, as in --train.max-splats 20000; `v3studio config` prints them all.
"""


def main() -> int:
    """Run the command in `sys.argv`; returns the exit code. A stopped run ends the process at once.

    Standard output gets what the command prints and nothing else: what native libraries print, here or in child
    processes, goes to standard error.
    """
    claim_stdout()
    code = execute(sys.argv[1:])
    if "--json" in sys.argv:
        sys.stdout = sys.stderr  # for what Python code prints while the process exits
    if code == EXIT_CANCELLED:
        # tearing down torch and its threads takes a while on a busy machine; who pressed Ctrl-C waits for nothing
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def execute(arguments: Sequence[str]) -> int:
    """Run a command inside this process; returns the exit code (SystemExit with 2 for wrong usage)."""
    arguments = _stages_of_now(arguments)
    parser, commands = _parser()
    # what is wrong with a command's arguments is told with that command's usage, not with that of all
    named = commands.get(arguments[0], parser) if arguments else parser
    plain = _long_settings_as_set(arguments, named)
    known, unknown = parser.parse_known_args(plain)
    if unknown:
        named.error(f"unrecognized arguments: {' '.join(unknown)}")
    try:
        known.overrides = _overrides(known)
        command: Callable[[argparse.Namespace], int] = known.command
        with _json_output() if getattr(known, "json", False) else nullcontext(sys.stdout) as known.output:
            code = command(known)
            known.output.flush()
        return code
    except StudioError as error:
        # with --json too: what fails before the first event would otherwise fail without a word
        print(f"error: {error}", file=sys.stderr)
        return 1
    except (Cancelled, KeyboardInterrupt):
        return EXIT_CANCELLED
    except BrokenPipeError:  # `v3studio config | head`
        discard(sys.stdout)
        return 1


@contextmanager
def _json_output() -> Iterator[TextIO]:
    """Standard output, for JSON alone: what Python code prints inside the block goes to standard error."""
    output = sys.stdout
    as_utf8(output)
    with redirect_stdout(sys.stderr):
        try:
            yield output
        finally:
            with suppress(BrokenPipeError):
                output.flush()


def _parser() -> tuple[argparse.ArgumentParser, dict[str, argparse.ArgumentParser]]:
    """The parser, and that of each command."""
    from pipelines.commands import ablate, export, import_splats, play, serve
    from pipelines.takes.take import program_version

    parser = _Parser(
        prog="v3studio",
        description="From synchronized multi-camera footage of a performer to a streamable Gaussian video.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"v3studio {program_version()}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    run = _stage_parser(commands, "run", "bring a take up to date: every stage that must run, and no other")
    run.add_argument(
        "--until", choices=list(STAGE_HELP), metavar="STAGE", help=f"stop after this stage ({', '.join(STAGE_HELP)})"
    )
    run.set_defaults(command=_run, stage=None)
    for name, text in STAGE_HELP.items():
        stage = _stage_parser(commands, name, f"run one stage: {text}")
        stage.add_argument("--force", action="store_true", help="run it from its beginning, even if it is up to date")
        if name == "bake":
            _add_targets(stage)
        stage.set_defaults(command=_run, stage=name, until=None)

    status = commands.add_parser("status", help="tell what is done, stale or missing in a take", allow_abbrev=False)
    status.add_argument("take", type=Path, metavar="DIR", help="the take's folder")
    status.add_argument("--json", action="store_true", help="print JSON")
    status.set_defaults(command=_status)

    play.register(commands)
    serve.register(commands)
    export.register(commands)
    import_splats.register(commands)
    ablate.register(commands)

    add_board_command(commands)
    add_sync_command(commands)

    config = commands.add_parser(
        "config",
        help="print all settings with their documentation",
        epilog=_SETTINGS_NOTE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    config.add_argument("config", type=Path, nargs="?", metavar="CONFIG", help="show the values of this file")
    config.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE", help="override a setting")
    config.set_defaults(command=_config)
    return parser, dict(commands.choices)


class _Parser(argparse.ArgumentParser):
    """Reads numbers with errors in plain words; its commands' parsers are of this kind too."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.register("type", int, _whole)
        self.register("type", float, _number)


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no whole number; give one, as in 24") from None


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is no number; give one, as in 2.5")
    return value


class _Target(argparse.Action):
    """A target of the bake as `--set`, clearing the other one, which the take may remember; the last given wins."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        """Called by argparse."""
        cleared = [f"bake.{name}=null" for name in ("target_kb_per_frame", "target_psnr") if name != self.const]
        namespace.set = [*namespace.set, *cleared, f"bake.{self.const}={values}"]


def _add_targets(stage: argparse.ArgumentParser) -> None:
    """What people bake for, as options of their own beside --set."""
    for name, metavar, text in (
        ("target_kb_per_frame", "KB", "search the QP of each group for at most this many kilobytes a frame"),
        ("target_psnr", "DB", "search the QP of each group for at least this PSNR against the trained frames, drawn"),
    ):
        stage.add_argument(f"--{name.replace('_', '-')}", action=_Target, const=name, metavar=metavar, help=text)


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
        help="YAML file; without it, or with a take's folder in its place, the take's own settings",
    )
    parser.add_argument("--take", type=Path, metavar="DIR", help="the take's folder; made if needed")
    parser.add_argument("--json", action="store_true", help="print events as JSON lines instead of progress bars")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE", help="override a setting")
    return parser


def _long_settings_as_set(arguments: Sequence[str], parser: argparse.ArgumentParser) -> list[str]:
    """`--section.name VALUE` and `--section.name=VALUE` as `--set section.name=VALUE`; the rest as it is."""
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


def _stages_of_now(arguments: Sequence[str]) -> list[str]:
    """Stages by the names of now, as a command and after `--until`."""
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
    given = getattr(arguments, "set", [])  # not every command takes settings
    if not given:
        return []
    from pipelines.config.loading import parse_override

    return [parse_override(text) for text in given]


def _run(arguments: argparse.Namespace) -> int:
    from pipelines.config import load_config
    from pipelines.takes.atomic_files import disk_errors
    from pipelines.takes.take import Take

    if arguments.take is None and arguments.config is not None and arguments.config.is_dir():
        arguments.config, arguments.take = None, arguments.config
    if arguments.take is None:
        if arguments.config is not None and not arguments.config.exists():
            raise StudioError(f"{arguments.config}: there is no such file or folder; give a YAML file and --take DIR.")
        raise StudioError("No take is named; give its folder, as in --take takes/first.")
    if arguments.config is not None and arguments.config.is_dir():
        raise StudioError(
            f"{arguments.config} is a folder, and --take names one too; leave it out, or give a YAML file in its place."
        )
    if arguments.config is None:
        take = Take.open(arguments.take)
        config = load_config(take.config, arguments.overrides)
    else:
        # settings are checked before a folder is made
        config = load_config(arguments.config, arguments.overrides)
        with disk_errors(arguments.take):
            take = Take.create(arguments.take)

    from pipelines.runs.console import Bars, JsonLines
    from pipelines.runs.runner import ALL_STAGES, run

    if arguments.stage:
        stages: Sequence[str] = (arguments.stage,)
    else:
        stages = ALL_STAGES[: ALL_STAGES.index(arguments.until) + 1] if arguments.until else ALL_STAGES
    with JsonLines(arguments.output) if arguments.json else Bars() as show:
        run(
            take,
            config,
            show,
            stages=stages,
            force=bool(arguments.stage and arguments.force),
            command=f"v3studio {arguments.stage or 'run'}",
        )
    if not arguments.json and "evaluate" in stages:
        from pipelines.reports.tables import print_evaluation

        print_evaluation(take)
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
