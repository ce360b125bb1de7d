"""`v3studio bake list`, `keep` and `remove`: bakes of a take that are kept under names."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.commands.common.arguments import add_command
from v3studio.pipelines.reports.terminal import console, escaped, say, table_of

if TYPE_CHECKING:
    from v3studio.pipelines.takes.take import Take


def register(commands: Any) -> None:
    _command(commands, "list", "list the bakes that a take keeps, with size and quality", _list)
    keep = _command(
        commands,
        "keep",
        "keep the take's stream under a name",
        _keep,
        "It becomes the folder TAKE/bakes/NAME, which can be played, exported, shared, and compared like a take.",
    )
    keep.add_argument("name", metavar="NAME", help="name of the bake, such as qp26")
    remove = _command(commands, "remove", "delete kept bakes; the take's stream stays", _remove)
    remove.add_argument("name", nargs="+", metavar="NAME", help="name of the bake")


def _command(
    commands: Any, name: str, text: str, command: Callable[[argparse.Namespace], None], more: str = ""
) -> argparse.ArgumentParser:
    parser = add_command(commands, f"bake {name}", text, command, more)
    parser.add_argument("take", type=Path, metavar="TAKE", help="folder of the take")
    return parser


def _list(arguments: argparse.Namespace) -> None:
    from v3studio.pipelines.takes.results.kept_bakes import kept_bakes
    from v3studio.pipelines.takes.take import Take

    bakes = kept_bakes(Take.open(arguments.take))
    arguments.result = {"bakes": [kept.to_json() for kept in bakes]}
    if arguments.json:
        return
    if not bakes:
        say("No bakes are kept. `v3studio bake keep TAKE NAME` keeps the stream.")
        return
    shown = table_of("name", "quality", "MB", "KB/frame", "PSNR", "baked", "", left=(0, 1, 5, 6))
    for kept in bakes:
        notes = {
            "stream": kept.is_stream, "older training": not kept.current, "other edits": not kept.same_edits,
            f"other {', '.join(kept.other_settings)}": kept.other_settings != (),
        }  # fmt: skip
        shown.add_row(
            escaped(kept.name),
            kept.quality,
            f"{kept.bytes / 1e6:.2f}",
            f"{kept.summary.bytes_per_frame / 1000:.1f}",
            "-" if kept.psnr is None else f"{kept.psnr:.2f}",
            kept.baked[:16].replace("T", " "),
            ", ".join(words for words, holds in notes.items() if holds),
        )
    console().print(shown)


def _keep(arguments: argparse.Namespace) -> None:
    from v3studio.pipelines.takes.results.kept_bakes import keep_bake

    def keep(take: Take) -> None:
        arguments.result = {"path": str(keep_bake(take, arguments.name).take.root.absolute())}

    _change(arguments, "keep", keep)


def _remove(arguments: argparse.Namespace) -> None:
    from v3studio.pipelines.takes.results.kept_bakes import kept_bake, remove_bake

    def remove(take: Take) -> None:
        for name in arguments.name:
            kept_bake(take, name)
        for name in arguments.name:
            remove_bake(take, name)

    _change(arguments, "remove", remove)


def _change(arguments: argparse.Namespace, name: str, change: Callable[[Take], object]) -> None:
    from v3studio.pipelines.takes.files.disk_errors import disk_errors
    from v3studio.pipelines.takes.results.kept_bakes import kept_bakes
    from v3studio.pipelines.takes.take import Take

    take = Take.open(arguments.take)
    with take.locked(f"v3studio bake {name}"), disk_errors(take.root):
        change(take)
        arguments.result |= {"bakes": [kept.to_json() for kept in kept_bakes(take)]}
