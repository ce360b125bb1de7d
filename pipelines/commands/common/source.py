"""SOURCE, what several commands begin from: a folder of footage, a YAML file of settings, or the folder of a take."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.commands.common.arguments import add_settings
from v3studio.studio.storage.address import StoreAddress, is_address

if TYPE_CHECKING:
    from v3studio.pipelines.config import Config

PRESETS = ("preview", "standard", "final")  # names of `pipelines.config.presets.PRESETS`, which takes long to import


def source_path(text: str) -> Path:
    """The type of the argument: a path, or an address in object storage."""
    return StoreAddress(text) if is_address(text) else Path(text)


def add_source(parser: argparse.ArgumentParser, nargs: str | None = None, note: str = "") -> None:
    """Add the argument SOURCE, and settings."""
    parser.add_argument(
        "source",
        type=source_path,
        metavar="SOURCE",
        help=f"folder of footage, YAML file of settings, or folder of a take{note}",
        nargs=nargs,
    )
    add_settings(parser)


def add_preset(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--preset",
        choices=PRESETS,
        help="training schedule: preview, standard (for CPUs) or final (the paper's, for GPUs); for a folder of "
        "footage, by default the one that suits this machine",
    )


def is_take(path: Path) -> bool:
    return (path / "take.json").is_file()


def is_footage(path: Path) -> bool:
    """Return whether this can be only footage: an address, or a folder that is not a take."""
    return is_address(path) or (path.is_dir() and not is_take(path))


def read_settings(
    source: Path | None, overrides: Sequence[tuple[str, Any]] = (), preset: str | None = None, take: Path | None = None
) -> Config:
    """The settings that a command works with: of a YAML file or a take, or the preset for this machine for footage
    without settings, also where only `capture.root` says where it is.

    `source` None: those of `take`, the folder of the take that they are for, if any, or the defaults if there is none
    yet. If it exists, footage gets its settings.
    """
    from v3studio.pipelines.config import load_config
    from v3studio.pipelines.config.presets import PRESETS as VALUES
    from v3studio.pipelines.config.presets import preset_here
    from v3studio.pipelines.takes.authored.drawn_masks import for_another_take
    from v3studio.pipelines.takes.take import Take

    given: list[tuple[str, Any]] = []
    file = source
    if source is None or is_footage(source):
        there = take is not None and (is_take(take) or (source is None and take.is_dir()))
        file = Take.open(take).config if take is not None and there else None
        if source is not None and file is not None and not file.is_file():  # killed before the settings were written
            file = None
    elif source.is_dir():
        file = Take.open(source).config
    if source is not None and is_footage(source):
        given.append(("capture.root", str(source)))
    preset = preset or (preset_here() if file is None else None)
    if preset is not None:
        given += VALUES[preset].items()
    return for_another_take(load_config(file, [*given, *overrides]), file, take)
