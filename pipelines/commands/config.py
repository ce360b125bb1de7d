"""`v3studio config`: settings with their documentation."""

import argparse
from typing import Any

from v3studio.pipelines.commands.common.arguments import add_command, add_settings, invalid_option, nearest
from v3studio.pipelines.commands.common.source import read_settings, source_path

SECTIONS = ("capture", "calibrate", "initialize", "train", "bake", "evaluate", "run")
"""The sections of `Config`, which takes long to import."""


def register(commands: Any) -> None:
    more = "The output is YAML that can be edited and used for a run. Without a SOURCE, settings have their defaults."
    text = "print settings with their documentation"
    config = add_command(commands, "config", text, _config, more)
    config.add_argument(
        "words",
        nargs="*",
        metavar="SOURCE|SECTION",
        help="folder of footage, YAML file of settings, or folder of a take to take values from; sections to print: "
        f"{', '.join(SECTIONS)} (default: all)",
    )
    config.add_argument("--changed", action="store_true", help="print only settings that differ from their defaults")
    add_settings(config)


def _config(arguments: argparse.Namespace) -> None:
    from v3studio.pipelines.config import Config, describe, load_config
    from v3studio.pipelines.config.config import values_of
    from v3studio.studio.yaml_text import parse_yaml

    sections = [word for word in arguments.words if word in SECTIONS]
    sources = [word for word in arguments.words if word not in SECTIONS]
    if len(sources) > 1:
        raise invalid_option(
            "SOURCE", f"{' and '.join(sources)}: more than one source", f"Sections are {', '.join(SECTIONS)}."
        )
    if sources and not source_path(sources[0]).exists() and (near := nearest(sources[0], SECTIONS)):
        raise invalid_option("SOURCE", f"{sources[0]} is neither a file nor a section{near}", "")
    config = (
        read_settings(source_path(sources[0]), arguments.overrides)
        if sources
        else load_config(None, arguments.overrides)
    )
    usual, given = values_of(Config()), values_of(config)
    names = [
        name
        for name, value in given.items()
        if (not sections or name.split(".")[0] in sections) and (not arguments.changed or value != usual[name])
    ]
    whole = not sections and not arguments.changed
    text = describe(config, None if whole else names) if names else "# All settings have their defaults.\n"
    arguments.result = {"settings": parse_yaml(text) or {}}
    if not arguments.json:
        print(text.rstrip())  # byte for byte, since it becomes a file
