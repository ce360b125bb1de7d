"""`v3studio ...`: the command line.

Exit codes: 0 success; 1 a failure; 2 wrong usage, including settings on the command line; both are reported as
`error: ...` on stderr; 130 cancelled (Ctrl-C, SIGTERM).
With `--json`, an error is also reported as the last line on stdout: the event `run_finished` with the outcome "failed"
and the error's code and fields.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from typing import TextIO

from pipelines.commands.board import add_board_command, add_sync_command
from pipelines.commands.common.arguments import CommandParser, long_settings_as_set, overrides
from pipelines.events.cancellation import EXIT_CANCELLED
from pipelines.stages import STAGE_NAMES
from studio.errors import Cancelled, StudioError
from studio.process import as_utf8, claim_stdout, discard, passive_openmp

GROUPS = {
    "Make a stream from footage": ("init", "estimate", "run", "status", "cancel", "queue", "config"),
    "Stages": STAGE_NAMES,
    "Prepare a capture": ("board", "sync", "colors"),
    "Use streams and takes": ("open", "play", "serve", "share", "publish", "export", "import"),
    "Use other machines": ("work",),
    "Keep takes": ("edit", "check", "bakes"),
    "Research": ("compare", "ablate"),
}
"""Commands in the order of `v3studio --help`."""

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
    parser, commands = _parser()
    # errors in the arguments of a command show the usage of that command
    named = commands.get(arguments[0], parser) if arguments else parser
    plain = long_settings_as_set(arguments, named)
    known, unknown = parser.parse_known_args(plain)
    if unknown:
        named.error(f"unrecognized arguments: {' '.join(unknown)}")
    try:
        known.overrides = overrides(known)
        command: Callable[[argparse.Namespace], int] = known.command
        with _json_output() if getattr(known, "json", False) else nullcontext(sys.stdout) as known.output:
            try:
                code = command(known)
            except StudioError as error:
                if getattr(known, "json", False) and not getattr(known, "reported", False):
                    _print_failure(error, known.output)
                raise
            known.output.flush()
        return code
    except StudioError as error:
        print(f"error: {error}", file=sys.stderr)
        return _exit_code(error)
    except (Cancelled, KeyboardInterrupt):
        return EXIT_CANCELLED
    except BrokenPipeError:  # `v3studio config | head`
        discard(sys.stdout)
        return 1


def _exit_code(error: StudioError) -> int:
    """2 for what is wrong with the arguments, also with settings among them; 1 for everything else."""
    from pipelines.config.loading import COMMAND_LINE

    return 2 if error.code.startswith("command.") or error.file == COMMAND_LINE else 1


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
        bakes,
        cancel,
        check,
        colors,
        compare,
        config,
        edit,
        estimate,
        export,
        import_splats,
        init,
        open_window,
        play,
        publish,
        queue,
        run,
        serve,
        share,
        status,
        work,
    )
    from pipelines.version import program_version

    parser = _MainParser(
        prog="v3studio",
        description="Turn synchronized multi-camera footage of a performer into a streamable Gaussian video.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"v3studio {program_version()}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND", parser_class=CommandParser)
    parser.summaries = lambda: {action.dest: str(action.help) for action in commands._choices_actions}
    for module in (
        run,
        status,
        estimate,
        cancel,
        queue,
        work,
        edit,
        check,
        bakes,
        open_window,
        play,
        serve,
        share,
        publish,
        export,
        import_splats,
        colors,
        compare,
        ablate,
        config,
        init,
    ):
        module.register(commands)
    add_board_command(commands)
    add_sync_command(commands)
    return parser, dict(commands.choices)


class _MainParser(CommandParser):
    """Lists commands by group in its help."""

    summaries: Callable[[], dict[str, str]]
    """Returns a line about each command."""

    def format_help(self) -> str:
        """Called by argparse."""
        summaries = self.summaries()
        lines = ["usage: v3studio [--help] [--version] COMMAND ...", "", str(self.description), ""]
        for title, names in GROUPS.items():
            lines += [f"{title}:", *(f"    {name:<12} {summaries[name]}" for name in names), ""]
        lines += ["Options:", "    -h, --help  show this help", "    --version   show the version", "", _EXAMPLES]
        return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
