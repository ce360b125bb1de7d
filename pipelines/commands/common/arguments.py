"""What the arguments of several commands have in common: numbers, settings, and names that have changed."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from typing import Any

from studio.errors import StudioError

SETTINGS_NOTE = """settings:
  --set SECTION.NAME=VALUE    or    --SECTION.NAME VALUE
  Overrides a setting; example: --train.max-splats 20000. `v3studio config` lists all settings.
"""


class CommandParser(argparse.ArgumentParser):
    """Gives clear errors for numbers, takes no abbreviated options, and shows an epilog as it is written."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        as_written = argparse.RawDescriptionHelpFormatter if options.get("epilog") else argparse.HelpFormatter
        super().__init__(*arguments, **{"allow_abbrev": False, "formatter_class": as_written, **options})
        self.register("type", int, _integer)
        self.register("type", float, _number)


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


def long_settings_as_set(arguments: Sequence[str], parser: argparse.ArgumentParser) -> list[str]:
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


def invalid_option(option: str, problem: str, fix: str, value: Any = None, **fields: Any) -> StudioError:
    """The error for an option whose value cannot be used (`command.invalid_option`)."""
    return StudioError("command.invalid_option", problem, value=value, fix=fix, option=option, **fields)


def three_numbers(text: str) -> tuple[float, float, float] | None:
    """The numbers in "X,Y,Z"; None if it is something else."""
    try:
        x, y, z = (float(value) for value in text.split(","))
    except ValueError:
        return None
    return x, y, z


def overrides(arguments: argparse.Namespace) -> list[tuple[str, Any]]:
    """Names and values of the settings given with `--set`; StudioError if one cannot be read."""
    given = getattr(arguments, "set", [])  # not every command has settings
    if not given:
        return []
    from pipelines.config.loading import parse_override

    return [parse_override(text) for text in given]
