"""Arguments that several commands have in common: numbers, settings, and names that have changed."""

import argparse
import difflib
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NoReturn

from v3studio.pipelines.reports.terminal import say
from v3studio.studio.capture.frame_range import ALL_FRAMES, parse_frame_range
from v3studio.studio.errors import StudioError

_SETTINGS_NOTE = """settings:
  --set SECTION.NAME=VALUE    or    --SECTION.NAME VALUE
  Overrides a setting; example: --train.max-splats 20000. `v3studio config` lists all settings.
"""


class WrongUsage(SystemExit):
    """Arguments that a parser does not take; it has said so on standard error. `problem`: a sentence."""

    def __init__(self, problem: str) -> None:
        super().__init__(2)
        self.problem = problem


class _HelpFormatter(argparse.HelpFormatter):
    """Wraps descriptions, and shows notes of several lines as they are written."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text.rstrip() if "\n" in text.strip() else super()._fill_text(text, width, indent)


class CommandParser(argparse.ArgumentParser):
    """Gives clear errors for numbers and typos, takes no abbreviated options, and shows an epilog as it is written."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **{"allow_abbrev": False, "formatter_class": _HelpFormatter, **options})
        self.register("type", int, _integer)
        self.register("type", float, number)

    def error(self, message: str) -> NoReturn:
        """Called by argparse. Raises WrongUsage."""
        self.print_usage(sys.stderr)
        say(f"{self.prog}: error: {message}", error=True)
        raise WrongUsage(message)

    def refuse(self, words: Sequence[str], meant: str = "") -> NoReturn:
        """Say that arguments are not known, and perhaps what was `meant`. Raises WrongUsage."""
        options = [option for action in self._actions for option in action.option_strings]
        near = [nearest(word.partition("=")[0], options) for word in words if word.startswith("-")]
        self.error(f"unrecognized arguments: {' '.join(words)}{meant}{''.join(near)}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Called by argparse for arguments with choices."""
        choices = [] if action.choices is None else [str(choice) for choice in action.choices]
        if choices and str(value) not in choices:
            near = nearest(str(value), choices) or f" (choose from {', '.join(choices)})"
            raise argparse.ArgumentError(action, f"invalid choice: '{value}'{near}")


def add_command(
    commands: Any,
    name: str,
    text: str,
    command: Callable[[argparse.Namespace], int | None] | None = None,
    more: str = "",
    **options: Any,
) -> CommandParser:
    """Add a command; its own help begins with `text`, its line in the list of commands, without a period. `command`
    returns the exit code, or None for 0; None: it has commands of its own."""
    description = f"{text[0].upper()}{text[1:]}.{f' {more}' if more else ''}"
    parser: CommandParser = commands.add_parser(name, help=text, description=description, **options)
    parser.set_defaults(command=command)
    return parser


def nearest(word: str, known: Iterable[str]) -> str:
    """ "; did you mean NAME?" for a typo; "" if nothing is similar."""
    matches = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {matches[0]}?" if matches else ""


def _integer(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not an integer; example: 24") from None


def number(text: str) -> float:
    """The type of finite numbers."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number; example: 2.5")
    return value


def long_settings_as_set(arguments: Sequence[str], parser: CommandParser) -> list[str]:
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
            if following is None or following.startswith("--"):
                parser.error(f"--{name} needs a value")
            value = following
        plain.append(f"--set={name}={value}")
    return plain


def print_text(arguments: argparse.Namespace, text: str) -> None:
    """Print text for people: nothing with `--json`, where `arguments.result` is for programs."""
    if text and not arguments.json:
        say(text)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the option `--set`, and a note about settings."""
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE", help="override a setting")
    parser.epilog = "\n".join(filter(None, [parser.epilog, _SETTINGS_NOTE]))


def add_overwrite(parser: argparse.ArgumentParser, text: str = "replace the output if it exists") -> None:
    parser.add_argument("--overwrite", action="store_true", help=text)


def frame_range(text: str) -> tuple[int | None, int | None, int]:
    """The type of frame ranges: "A:B", "A:B:S" or parts of it, frames A to B - 1 in steps of S."""
    try:
        return parse_frame_range(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_frames(parser: argparse.ArgumentParser, verb: str, note: str = "", steps: bool = True) -> None:
    """Add the option `--frames`, a `frame_range`; steps: whether the command accepts a step."""
    every = ", or every Sth of them," if steps else ","
    parser.add_argument(
        "--frames",
        type=frame_range,
        default=ALL_FRAMES,
        metavar="A:B[:S]" if steps else "A:B",
        help=f"{verb} only the frames A to B - 1{every} by their numbers in the footage (in a stream: from 0){note}",
    )


def invalid_option(option: str, problem: str, fix: str, value: Any = None, **fields: Any) -> StudioError:
    """The error for an option whose value cannot be used (`command.invalid_option`)."""
    return StudioError("command.invalid_option", problem, value=value, fix=fix, option=option, **fields)


def three_numbers(text: str) -> tuple[float, float, float]:
    """The type of "X,Y,Z"."""
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not three numbers; example: 0,1,0") from None
    return x, y, z


def overrides(arguments: argparse.Namespace) -> list[tuple[str, Any]]:
    """Names and values of the settings given with `--set`; StudioError if one cannot be read."""
    given = getattr(arguments, "set", [])  # not every command has settings
    if not given:
        return []
    from v3studio.pipelines.config.loading import parse_override

    return [parse_override(text) for text in given]
