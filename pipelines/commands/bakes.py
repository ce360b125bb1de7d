"""`v3studio bakes`: bakes of a take that are kept under names."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipelines.takes.take import Take


def register(commands: Any) -> None:
    """Add the command to the command line."""
    command = commands.add_parser(
        "bakes",
        help="show the bakes that a take keeps, or keep the present one",
        description="Show the bakes that a take keeps under names, with size and quality. A kept bake is the folder "
        "TAKE/bakes/NAME, which can be played, exported, shared, and compared with `v3studio compare` like a take. "
        "`v3studio bake TAKE --keep NAME` bakes and keeps.",
    )
    command.add_argument("take", type=Path, metavar="TAKE", help="folder of the take")
    command.add_argument("--keep", metavar="NAME", help="keep the take's stream under this name, such as qp26")
    command.add_argument("--json", action="store_true", help="print JSON")
    command.set_defaults(command=_bakes)


def _bakes(arguments: argparse.Namespace) -> int:
    from pipelines.takes.kept_bakes import kept_bakes
    from pipelines.takes.take import Take

    take = Take.open(arguments.take)
    if arguments.keep is not None:
        _keep(take, arguments.keep)
    found = kept_bakes(take)
    if arguments.json:
        print(json.dumps([kept.to_json() for kept in found], indent=1), file=arguments.output)
        return 0
    if not found:
        print("No bakes are kept. `v3studio bakes TAKE --keep NAME` keeps the present one.")
        return 0
    from pipelines.reports.tables import escaped, table_of
    from pipelines.reports.terminal import console

    shown = table_of("name", "quality", "MB", "KB/frame", "PSNR", "baked", "", left=(0, 1, 5, 6))
    for kept in found:
        notes = {"stream": kept.is_stream, "older training": not kept.current, "other edits": not kept.same_edits}
        shown.add_row(
            escaped(kept.name),
            kept.quality,
            f"{kept.bytes / 1e6:.2f}",
            f"{kept.bytes_per_frame / 1000:.1f}",
            "-" if kept.psnr is None else f"{kept.psnr:.2f}",
            kept.baked[:16].replace("T", " "),
            ", ".join(words for words, holds in notes.items() if holds),
        )
    console().print(shown)
    return 0


def _keep(take: Take, name: str) -> None:
    from pipelines.takes.atomic_files import disk_errors
    from pipelines.takes.kept_bakes import keep_bake

    with take.locked("v3studio bakes --keep"), disk_errors(take.root):
        keep_bake(take, name)
