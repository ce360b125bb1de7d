"""Tables in the terminal: evaluation, status, playback."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pipelines.reports.terminal import console
from pipelines.takes.atomic_files import read_json
from pipelines.takes.take import Take

if TYPE_CHECKING:
    from rich.table import Table

    from studio.playback import PlaybackReport

_FOUR_DIGITS = ("ssim_trained", "ssim_decoded", "lpips_trained", "lpips_decoded")


def print_evaluation(take: Take) -> None:
    """A row a frame, the means, and how it was measured."""
    evaluation = read_json(take.evaluation)
    summary, protocol = evaluation["summary"], evaluation["protocol"]
    screen = console()
    lpips = ("LPIPS trained", "decoded") if "lpips_trained" in summary else ()
    table = table_of("frame", "group", "splats", "PSNR trained", "decoded", "SSIM trained", "decoded", *lpips, "KB")
    for row in evaluation["frames"]:
        mark = "*" if row["keyframe"] else ""
        table.add_row(
            f"{row['frame']}{mark}", str(row["group"]), str(row["splats"]), *_quality(row), f"{row['bytes'] / 1000:.1f}"
        )
    table.add_section()
    table.add_row("mean", "", "", *_quality(summary), f"{summary['bytes_per_frame'] / 1000:.1f}")
    screen.print(table)
    which = "held-out" if protocol["held_out"] else "TRAINING (none is held out)"
    screen.print(
        f"{which} cameras {', '.join(protocol['cameras'])}; {protocol['crop']}; background "
        f"{tuple(protocol['background'])}; {protocol['total_bytes']:,} bytes in all. * keyframe"
        + (f"\nLPIPS: {protocol['lpips']}" if lpips else ""),
        style="dim",
        markup=False,
    )
    screen.print(f"stream: {take.stream}\nreport: {take.report}", markup=False, soft_wrap=True)


def print_playback(report: PlaybackReport) -> None:
    """A row a frame and the spread, in milliseconds, as the paper's table of a player's runtime."""
    screen = console()
    figures = ["fetch_ms", "decode_ms", "dequantize_ms"]
    if any(row.render_ms is not None for row in report.frames):
        figures.append("render_ms")
    table = table_of("frame", "group", "KB", *(figure.replace("_", " ") for figure in figures))
    for row in report.frames:
        table.add_row(
            str(row.frame), str(row.group), f"{row.bytes / 1000:.1f}",
            *(f"{getattr(row, figure):.2f}" for figure in figures),
        )  # fmt: skip
    table.add_section()
    spreads = [report.spread(figure) for figure in ("bytes", *figures)]
    for name in ("mean", "median", "p95", "max"):
        values = [getattr(spread, name) for spread in spreads]
        table.add_row(name, "", f"{values[0] / 1000:.1f}", *(f"{value:.2f}" for value in values[1:]))
    screen.print(table)
    screen.print(
        f"{report.shown} frames in {report.seconds:.2f} s: {report.fps:.1f} frames a second, {report.dropped} left out"
        + (f", {sum(group.frame_count for group in report.skipped)} lost to damage" if report.skipped else "")
    )


def _quality(row: dict[str, Any]) -> tuple[str, ...]:
    return (
        f"{row['psnr_trained']:.2f}", f"{row['psnr_decoded']:.2f}",
        *(f"{row[name]:.4f}" for name in _FOUR_DIGITS if name in row),
    )  # fmt: skip


def table_of(*columns: str, left: tuple[int, ...] = ()) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for number, column in enumerate(columns):
        table.add_column(column, justify="left" if number in left else "right")
    return table


def escaped(text: str) -> str:
    from rich.markup import escape

    return escape(text)
