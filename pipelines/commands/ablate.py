"""`v3studio ablate`: each part of training left out in turn, and what that does to quality and size."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

_HELP = "train without each part of the method in turn and compare quality and size"
_NOTE = """The first variant is the full method as CONFIG has it. Each other one leaves a part out, is trained (cameras,
initial points and keyframes are shared where they are the same), baked at several QPs, decoded and measured on the
held-out cameras. DIR gets ablation.json, ablation.png, ablation.html and a take for each variant; a stopped run goes
on where it stopped. This trains once for each variant: try few frames first, as in --capture.stop 20.
"""


def register(commands: Any) -> None:
    """Add the command to the parser."""
    from pipelines.ablation.variants import OPTIONS, QPS, VARIANTS

    names = ", ".join(variant.name for variant in VARIANTS)
    more = ", ".join(variant.name for variant in OPTIONS)
    parser = commands.add_parser(
        "ablate",
        help=_HELP,
        description=_HELP[0].upper() + _HELP[1:] + ".",
        epilog=_NOTE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="the full method, as for `v3studio run`")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for results and takes")
    parser.add_argument(
        "--variants",
        default="",
        metavar="A,B",
        help=f"only these ({names}), or settings beyond the paper ({more}); the full method is always there",
    )
    parser.add_argument(
        "--qps", default=",".join(map(str, QPS)), metavar="N,N", help="QPs to bake at (default %(default)s)"
    )
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE", help="override a setting")
    parser.set_defaults(command=_ablate)


def _ablate(arguments: argparse.Namespace) -> int:
    from pipelines.ablation.report import table_rows, write_plot, write_report
    from pipelines.ablation.study import ablate
    from pipelines.ablation.variants import chosen
    from pipelines.config import load_config
    from pipelines.reports.terminal import console
    from pipelines.runs.console import Bars

    qps = _qps(arguments.qps)
    variants = chosen([name for name in arguments.variants.split(",") if name])
    default = load_config(arguments.config, arguments.overrides).bake.qp
    qps = sorted({*qps, default})
    with Bars() as show:

        def told(what: str) -> Any:
            console().print(what)
            return show

        results = ablate(arguments.config, arguments.out, arguments.overrides, variants, qps, told)
    write_plot(results, arguments.out / "ablation.png")
    write_report(results, default, arguments.out / "ablation.html")
    from rich.table import Table

    header, *rows = table_rows(results, default)
    table = Table(*header)
    for row in rows:
        table.add_row(*row)
    console().print(table)
    console().print(f"figure and report: {arguments.out / 'ablation.png'}, {arguments.out / 'ablation.html'}")
    return 0


def _qps(text: str) -> list[int]:
    from studio.errors import StudioError

    try:
        qps = sorted({int(value) for value in text.split(",")})
    except ValueError:
        raise StudioError(f"--qps is '{text}'; give whole numbers with commas between, as in 12,16,20,24.") from None
    if len(qps) < 4 or not all(0 <= qp <= 51 for qp in qps):
        raise StudioError(f"--qps is '{text}'; give at least four, each from 0 to 51, or no curve can be compared.")
    return qps
