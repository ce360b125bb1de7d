"""`v3studio bakes`: bakes of a take that are kept under names."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipelines.takes.take import Take


def register(commands: Any) -> None:
    """Add the command and its subcommands to the command line."""
    command = commands.add_parser(
        "bakes",
        help="keep bakes of a take under names, choose one, remove others",
        description="Keep bakes of a take under names; one of them is the take's stream. A kept bake is the folder "
        "TAKE/bakes/NAME, which can be played, exported, shared, and compared with `v3studio compare` like a take. "
        "`v3studio bake TAKE --keep NAME` bakes and keeps.",
    )
    kinds = command.add_subparsers(title="commands", required=True, metavar="COMMAND")

    listing = _kind(kinds, "list", "show the kept bakes with their size and quality")
    listing.add_argument("--json", action="store_true", help="print JSON")
    listing.set_defaults(command=_list)

    keep = _kind(kinds, "keep", "keep the take's stream under a name")
    keep.add_argument("name", metavar="NAME", help="the name, such as qp26")
    keep.set_defaults(command=_keep)

    choose = _kind(kinds, "choose", "make a kept bake the take's stream, with its settings and its evaluation")
    choose.add_argument("name", metavar="NAME", help="the name of the bake")
    choose.add_argument(
        "--discard", action="store_true", help="also if the present stream is not kept under any name and is lost"
    )
    choose.set_defaults(command=_choose)

    remove = _kind(kinds, "remove", "delete kept bakes; the take's stream stays")
    remove.add_argument("name", nargs="+", metavar="NAME", help="the name of a bake")
    remove.set_defaults(command=_remove)


def _kind(kinds: Any, name: str, text: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = kinds.add_parser(
        name, help=text, description=f"{text[0].upper()}{text[1:]}.", allow_abbrev=False
    )
    parser.add_argument("take", type=Path, metavar="TAKE", help="folder of the take")
    parser.set_defaults(stage=f"bakes {name}")
    return parser


def _list(arguments: argparse.Namespace) -> int:
    from pipelines.reports.tables import escaped, table_of
    from pipelines.reports.terminal import console
    from pipelines.takes.kept_bakes import kept_bakes
    from pipelines.takes.take import Take

    found = kept_bakes(Take.open(arguments.take))
    if arguments.json:
        print(json.dumps([kept.to_json() for kept in found], indent=1), file=arguments.output)
        return 0
    if not found:
        print("No bakes are kept. `v3studio bakes keep TAKE NAME` keeps the present one.")
        return 0
    shown = table_of("name", "quality", "MB", "KB/frame", "PSNR", "baked", "", left=(0, 1, 5, 6))
    for kept in found:
        psnr = kept.psnr
        notes = {"chosen": kept.chosen, "older training": not kept.current, "other edits": not kept.same_edits}
        shown.add_row(
            escaped(kept.name),
            kept.quality,
            f"{kept.bytes / 1e6:.2f}",
            f"{kept.bytes_per_frame / 1000:.1f}",
            "-" if psnr is None else f"{psnr:.2f}",
            kept.baked[:16].replace("T", " "),
            ", ".join(words for words, holds in notes.items() if holds),
        )
    console().print(shown)
    return 0


def _keep(arguments: argparse.Namespace) -> int:
    from pipelines.takes.kept_bakes import keep_bake

    with _locked(arguments) as take:
        kept = keep_bake(take, arguments.name)
    print(f"kept as '{kept.name}' ({kept.bytes / 1e6:.2f} MB): {kept.take.root}")
    return 0


def _choose(arguments: argparse.Namespace) -> int:
    from pipelines.takes.kept_bakes import choose_bake

    with _locked(arguments) as take:
        kept = choose_bake(take, arguments.name, discard=arguments.discard)
    print(f"'{kept.name}' is the take's stream now, and its settings are those of the take")
    for remark in kept.remarks:
        print(remark)
    return 0


def _remove(arguments: argparse.Namespace) -> int:
    from pipelines.takes.kept_bakes import folder_of_bake, remove_bake

    with _locked(arguments) as take:
        for name in arguments.name:
            folder_of_bake(take, name)  # check all before the first is removed
        for name in dict.fromkeys(arguments.name):
            print(f"removed '{name}' ({remove_bake(take, name) / 1e6:.2f} MB freed)")
    return 0


@contextmanager
def _locked(arguments: argparse.Namespace) -> Iterator[Take]:
    """The take, locked."""
    from pipelines.takes.atomic_files import disk_errors
    from pipelines.takes.take import Take

    take = Take.open(arguments.take)
    with take.locked(f"v3studio {arguments.stage}"), disk_errors(take.root):
        yield take
