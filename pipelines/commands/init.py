"""`v3studio init`: writes a commented configuration for footage."""

import argparse
import shlex
from contextlib import suppress
from pathlib import Path
from typing import Any

from v3studio.pipelines.commands.common.arguments import add_command, add_overwrite, invalid_option, print_text
from v3studio.pipelines.commands.common.source import add_preset, add_source, is_footage, read_settings
from v3studio.pipelines.outputs import replacing
from v3studio.studio.atomic_files import write_text
from v3studio.studio.errors import StudioError

_SHOWN = ("capture.root", "capture.images", "capture.rig", "capture.masks", "capture.held_out", "capture.scale")
"""Settings that the file has in any case: those that are most often changed."""


def register(commands: Any) -> None:
    more = (
        "The YAML file has the settings that matter for this footage, each with its documentation. `v3studio config` "
        "prints all settings."
    )
    parser = add_command(commands, "init", "write a commented configuration for footage", _init, more)
    add_source(parser)
    add_preset(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: name of the footage, .yaml)")
    add_overwrite(parser)


def _init(arguments: argparse.Namespace) -> None:
    from v3studio.pipelines.config import Config, describe
    from v3studio.pipelines.config.config import values_of
    from v3studio.pipelines.inspection import inspect
    from v3studio.pipelines.takes.files.disk_errors import disk_errors

    source = arguments.source
    if arguments.out is not None and arguments.out.is_dir():
        raise invalid_option("--out", f"--out {arguments.out} is a folder", f"Example: --out {arguments.out}/my.yaml.")
    if not is_footage(source):
        problem = "is not a folder of footage"
        raise StudioError("command.not_footage", problem, file=source, fix="Specify the folder of the footage.")
    config = read_settings(source, arguments.overrides, arguments.preset)
    out = arguments.out or Path(f"{source.absolute().name}.yaml")
    sentences = inspect(config.capture).lines
    usual = values_of(Config())
    names = {name for name, value in values_of(config).items() if value != usual[name]} | set(_SHOWN)
    lines = ["# Written by `v3studio init`. Settings that are not here have their defaults: `v3studio config`.", "#"]
    text = "\n".join([*lines, *(f"# {sentence}" for sentence in sentences), "", describe(config, names)])
    with replacing(out, arguments.overwrite, _is_settings), disk_errors(out.absolute().parent):
        write_text(out, text)
    arguments.result = {"path": str(out.absolute()), "footage": list(sentences)}
    words = f"{out}: written. To run it: v3studio run {shlex.quote(str(out))} --take takes/first"
    print_text(arguments, "\n".join([*sentences, words]))


def _is_settings(path: Path) -> bool:
    from v3studio.pipelines.config import load_config

    with suppress(StudioError):
        return bool(load_config(path))
    return False
