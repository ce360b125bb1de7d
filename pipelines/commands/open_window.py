"""`v3studio open`: opens the window."""

import argparse
import sys
from typing import Any

from v3studio.pipelines.commands.common.arguments import add_command
from v3studio.studio.process import become, python_command


def register(commands: Any) -> None:
    more = "Without one, the start page. v3studio-gui is the same, with more options."
    parser = add_command(commands, "open", "open the window on a take, a stream, its URL, or a cast", _open, more)
    parser.add_argument(
        "place",
        nargs="?",
        metavar="TAKE|STREAM|CAST",
        help="folder of a take or of a stream, URL of a stream, or the .json document of a cast",
    )


def _open(arguments: argparse.Namespace) -> int:
    # the window is above the command line: it is started, not imported
    places = [] if arguments.place is None else [arguments.place]
    sys.stdout.flush()
    become(python_command("v3studio.gui.app", *places))
