"""`v3studio completion`: scripts with which shells complete commands, options and file names."""

import argparse
from collections.abc import Callable
from typing import Any

from pipelines.commands.common.arguments import CommandParser, print_text

_NOTE = """To use it:
  bash    v3studio completion bash > ~/.local/share/bash-completion/completions/v3studio
  zsh     v3studio completion zsh > ~/.zfunc/_v3studio    (with ~/.zfunc in fpath)
"""
_WITHOUT_FILES = (int, float)


def register(commands: Any, parser: Callable[[], tuple[CommandParser, dict[str, CommandParser]]]) -> None:
    """Add the command. `parser`: makes the parser of the command line, and those of its commands."""
    command = commands.add_parser(
        "completion",
        help="print a script that completes commands and options in a shell",
        description="Print a script with which a shell completes commands, options and file names.",
        epilog=_NOTE,
    )
    command.add_argument("shell", choices=("bash", "zsh"), help="the shell")
    command.set_defaults(command=lambda arguments: _completion(arguments, parser))


def _completion(
    arguments: argparse.Namespace, parser: Callable[[], tuple[CommandParser, dict[str, CommandParser]]]
) -> int:
    import shtab

    main, commands = parser()
    for command in commands.values():
        for action in command.arguments:
            if action.choices is None and action.nargs != 0 and action.type not in _WITHOUT_FILES:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    arguments.result = {"script": shtab.complete(main, shell=arguments.shell)}
    print_text(arguments, arguments.result["script"])
    return 0
