"""`v3studio ...`: the command line.

Exit codes: 0 success; 1 a failure; 2 wrong usage, including settings on the command line; both are reported as
`error: ...` on stderr; 130 cancelled (Ctrl-C, SIGTERM). With `--json`, a command prints events, one on a line. The last
one is `Finished`, with the outcome, the result and, if it failed, the error's code and fields.
"""

import argparse
import logging
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TextIO

from v3studio.pipelines import commands as command_modules
from v3studio.pipelines.commands import completion
from v3studio.pipelines.commands.common.arguments import (
    CommandParser,
    WrongUsage,
    long_settings_as_set,
    nearest,
    overrides,
)
from v3studio.pipelines.events import Finished, as_message
from v3studio.pipelines.events.cancellation import EXIT_CANCELLED
from v3studio.pipelines.events.event_log import JsonLines
from v3studio.pipelines.reports.terminal import say
from v3studio.pipelines.runs.out_of_memory import memory_errors
from v3studio.pipelines.stages import STAGE_NAMES
from v3studio.studio.atomic_files import PARTIAL
from v3studio.studio.errors import Cancelled, Message, StudioError, reason_of
from v3studio.studio.json_types import JsonData
from v3studio.studio.process import as_utf8, claim_stdout, discard, forget_working_folder, passive_openmp

GROUPS = {  # commands, in the order of `v3studio --help`
    "Make a stream from footage": ("init", "estimate", "run", "status", "cancel", "queue", "config", "completion"),
    "Stages": STAGE_NAMES,
    "Prepare a capture": ("board", "sync", "models", "models get"),
    "Use streams and takes": ("open", "play", "serve", "share", "publish", "export", "import"),
    "Manage takes": ("edit", "check", "bake list", "bake keep", "bake remove"),
    "Research": ("compare",),
}

_ABOUT = "Turn synchronized multi-camera footage of a performer into a streamable Gaussian video."

_EXAMPLES = """Examples:
    v3studio run footage/first --take takes/first
    v3studio run takes/first --bake.quality 24
    v3studio status takes/first
    v3studio export takes/first --format ply --out plys

Exit codes: 0 success, 1 failure, 2 wrong usage, 130 cancelled.
`v3studio COMMAND --help` shows the options of a command.
"""


def main() -> int:
    """Run the command in `sys.argv` and return the exit code. If it is cancelled, the process exits immediately.

    Only the command's own output goes to stdout; that of native libraries, here or in child processes, goes to stderr.
    """
    forget_working_folder()
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
    started = time.monotonic()
    try:
        known = parse(arguments)
    except WrongUsage as usage:
        if "--json" in arguments:
            JsonLines(sys.stdout)(_end(2, started, Message("command.usage", usage.problem), {}))
        raise
    as_json = bool(getattr(known, "json", False))
    known.result = {}
    with (
        _json_output() if as_json else nullcontext(sys.stdout) as output,
        _log_lines() if getattr(known, "verbose", False) else nullcontext(),
    ):
        known.emit = JsonLines(output)
        try:
            code, message = _run(known)
        except Exception as error:
            if as_json and not known.emit.finished:
                known.emit(_end(1, started, as_message(error), {}))
            raise
        if as_json and not known.emit.finished:
            known.emit(_end(code, started, message, known.result))
    return code


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The arguments of a command, whose function is `command`. Raises WrongUsage (a SystemExit)."""
    parser, commands = make_parser()
    pair = " ".join(arguments[:2])
    if pair in commands:  # `bake list`, beside `bake TAKE`
        arguments = [pair, *arguments[2:]]
    first = arguments[0] if arguments else ""
    seconds = [name.removeprefix(f"{first} ") for name in commands if name.startswith(f"{first} ")]
    if first not in commands and seconds:
        parser.error(f"there is no command '{first}'; there is {' and '.join(f'{first} {name}' for name in seconds)}")
    named = commands.get(first, parser)  # errors in the arguments of a command show the usage of that command
    known, unknown = parser.parse_known_args(long_settings_as_set(arguments, named))
    if unknown:
        given = [word if word in arguments else word.replace("--set=", "--", 1) for word in unknown]
        named.refuse(given, nearest(arguments[1], seconds) if seconds else "")
    return known


def _run(known: argparse.Namespace) -> tuple[int, Message | None]:
    """The exit code of the command, and what went wrong."""
    command: Callable[[argparse.Namespace], int | None] = known.command
    try:
        known.overrides = overrides(known)
        with memory_errors():
            code = command(known) or 0
        sys.stdout.flush()
    except StudioError as error:
        return _refused(error)
    except (Cancelled, KeyboardInterrupt):
        return EXIT_CANCELLED, Message("run.cancelled", "the command was cancelled")
    except BrokenPipeError:  # `v3studio config | head`
        discard(sys.stdout)
        return 1, None
    except OSError as error:
        if error.filename is None:
            raise
        file = Path(os.fsdecode(error.filename))
        problem = f"cannot be read or written ({reason_of(error)})"
        fix = "Check the path and its permissions."
        return _refused(
            StudioError("file.failed", problem, file=file.parent if PARTIAL in file.name else file, fix=fix)
        )
    return code, None


def _refused(error: StudioError) -> tuple[int, Message]:
    """Print the error; its message, and as exit code 2 for what is wrong with the arguments, also with settings among
    them, else 1."""
    from v3studio.studio.settings import COMMAND_LINE, OVERRIDES

    say(f"error: {error}", error=True)
    places = {mistake.get("file") for mistake in error.fields.get("mistakes", ())} or {error.file}
    usage = error.code.startswith("command.") or places <= {COMMAND_LINE, OVERRIDES}
    return 2 if usage else 1, error.message


def _end(code: int, started: float, message: Message | None, result: Mapping[str, JsonData]) -> Finished:
    """The last event of a command."""
    outcome = {0: "done", EXIT_CANCELLED: "cancelled"}.get(code, "failed")
    return Finished.of(message, outcome=outcome, seconds=round(time.monotonic() - started, 2), result=result)


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


@contextmanager
def _log_lines() -> Iterator[None]:
    """Standard error shows what the packages log."""
    log, lines = logging.getLogger("v3studio"), logging.StreamHandler()
    lines.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s"))
    log.addHandler(lines)
    log.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        log.setLevel(logging.NOTSET)
        log.removeHandler(lines)


def make_parser() -> tuple[CommandParser, dict[str, CommandParser]]:
    """The parser, and those of the commands by name."""
    from v3studio.pipelines.version import program_version

    parser = CommandParser(prog="v3studio", usage="%(prog)s [-h] [--version] COMMAND ...", epilog=_EXAMPLES)
    parser.add_argument("--version", action="version", version=f"v3studio {program_version()}")
    hidden = argparse.SUPPRESS  # the description lists the commands
    commands = parser.add_subparsers(required=True, metavar="COMMAND", help=hidden, prog=parser.prog)
    for module in iter_modules(command_modules.__path__):
        if module.name not in ("common", "completion"):
            import_module(f"v3studio.pipelines.commands.{module.name}").register(commands)
    completion.register(commands, parser)
    for name, command in commands.choices.items():
        if name != "open":  # becomes another program
            _add_common(command)
    summaries = {action.dest: action.help for action in commands._choices_actions}
    groups = [
        [f"{title}:", *(f"    {name:<12} {summaries[name]}" for name in names)] for title, names in GROUPS.items()
    ]
    parser.description = "\n\n".join([_ABOUT, *map("\n".join, groups)])
    return parser, dict(commands.choices)


def _add_common(command: argparse.ArgumentParser) -> None:
    """Add what all commands take to a command, or to each of the commands in it."""
    for action in command._actions:
        if isinstance(action, argparse._SubParsersAction):
            for kind in action.choices.values():
                _add_common(kind)
            return
    command.add_argument("--json", action="store_true", help="print events as JSON lines; the last one has the result")
    text = "say on standard error when stages, child processes and calls of libraries begin and end"
    command.add_argument("--verbose", action="store_true", help=text)


if __name__ == "__main__":
    sys.exit(main())
