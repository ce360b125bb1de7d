"""`v3studio completion`: scripts with which shells complete commands, options and file names."""

import argparse
from typing import Any

from v3studio.pipelines.commands.common.arguments import CommandParser, add_command, print_text

_NOTE = """To use it:
  bash    v3studio completion bash > ~/.local/share/bash-completion/completions/v3studio
  zsh     v3studio completion zsh > ~/.zfunc/_v3studio    (with ~/.zfunc in fpath)
"""
_WITHOUT_FILES = (int, float)


def register(commands: Any, parser: CommandParser) -> None:
    """Add the command. `parser`: of the command line; `commands` become its commands."""

    def complete(arguments: argparse.Namespace) -> None:
        import shtab

        commands.help = None  # shtab leaves out what help does
        # shells complete single words
        commands._choices_actions[:] = [action for action in commands._choices_actions if " " not in action.dest]
        for name, command_parser in list(commands.choices.items()):
            if " " in name:
                del commands.choices[name]
            for action in command_parser._actions:
                if action.choices is None and action.nargs != 0 and action.type not in _WITHOUT_FILES:
                    action.complete = shtab.FILE
        arguments.result = {"script": shtab.complete(parser, shell=arguments.shell)}
        print_text(arguments, arguments.result["script"])

    text = "print a script that completes commands, options and file names in a shell"
    command = add_command(commands, "completion", text, complete, epilog=_NOTE)
    command.add_argument("shell", choices=("bash", "zsh"), help="the shell")
