"""`v3studio ablate`: leaves out each part of training in turn and compares quality and size."""

import argparse
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from v3studio.pipelines.commands.common.arguments import add_command, add_overwrite, add_settings
from v3studio.pipelines.outputs import check_output, replacing

_NOTE = """The first variant is the full method with the settings in CONFIG; each other variant leaves out one part.
Every variant is trained (sharing cameras, initial points and keyframes where possible), baked at several QPs, decoded
and measured on held-out cameras. Writes ablation.json, ablation.png and one take per variant to DIR.
The same command resumes after a cancellation. Every variant is trained in full: try a few frames first
(--capture.frames :20).
"""


def register(commands: Any) -> None:
    from v3studio.pipelines.ablation.variants import OPTIONS, QPS, VARIANTS

    names = ", ".join(variant.name for variant in VARIANTS)
    more = ", ".join(variant.name for variant in OPTIONS)
    parser = add_command(
        commands,
        "ablate",
        "train without each part of the method in turn, and compare quality and size",
        _ablate,
        epilog=_NOTE,
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="YAML file of settings of the full method")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for results and takes")
    add_overwrite(parser, "delete earlier results in DIR and start over, instead of resuming")
    parser.add_argument(
        "--variants",
        default="",
        metavar="A,B",
        help=f"variants (default: {names}); beyond the paper: {more}; the full method is always included",
    )
    parser.add_argument(
        "--qps", type=_qps, default=",".join(map(str, QPS)), metavar="N,N", help="QPs to bake at (default: %(default)s)"
    )
    add_settings(parser)


def _ablate(arguments: argparse.Namespace) -> None:
    from v3studio.pipelines.ablation.report import table_rows, write_plot
    from v3studio.pipelines.ablation.study import ablate
    from v3studio.pipelines.ablation.variants import chosen
    from v3studio.pipelines.config import load_config
    from v3studio.pipelines.events import Emit, Event, Finished, Log
    from v3studio.pipelines.reports.terminal import console, table_of
    from v3studio.pipelines.runs.console import Bars
    from v3studio.pipelines.takes.files.disk_errors import disk_errors

    variants = chosen([name for name in arguments.variants.split(",") if name])
    default = load_config(arguments.config, arguments.overrides).bake.qp
    qps = sorted({*arguments.qps, default})
    check_output(arguments.out, True, _is_study)
    fresh = replacing(arguments.out, True, _is_study) if arguments.overwrite else nullcontext()
    with disk_errors(arguments.out), fresh, nullcontext(arguments.emit) if arguments.json else Bars() as show:

        def passed(event: Event) -> None:
            if not isinstance(event, Finished) or (event.outcome == "cancelled" and not arguments.json):
                show(event)

        def announced(what: str) -> Emit:
            show(Log(message=what))
            return passed

        results = ablate(arguments.config, arguments.out, arguments.overrides, variants, qps, announced)
    plot = arguments.out / "ablation.png"
    write_plot(results, plot)
    arguments.result = {"path": str(arguments.out.absolute()), **results.to_json()}
    if arguments.json:
        return
    header, *rows = table_rows(results, default)
    table = table_of(*header, left=(0,))
    for row in rows:
        table.add_row(*row)
    console().print(table)
    console().print(f"plot: {plot}")


def _is_study(out: Path) -> bool:
    """Return whether this is the folder of a study: its results, or its first take."""
    return (out / "ablation.json").is_file() or (out / "takes").is_dir()


def _qps(text: str) -> set[int]:
    qps = {int(value) if value.strip().isdecimal() else -1 for value in text.split(",")}
    if len(qps) < 4 or not all(0 <= qp <= 51 for qp in qps):  # fewer are no curve to compare
        raise argparse.ArgumentTypeError(
            f"'{text}' is not a list of at least four QPs from 0 to 51; example: 12,16,20,24"
        )
    return qps
