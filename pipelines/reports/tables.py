"""Tables in the terminal: evaluation and playback."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from v3studio.pipelines.reports.terminal import console, table_of
from v3studio.pipelines.takes.results.evaluation import Quality, read_evaluation
from v3studio.pipelines.takes.take import Take
from v3studio.studio.comparison.metrics import Metric
from v3studio.studio.counts import counted

if TYPE_CHECKING:
    from v3studio.studio.playback import PlaybackReport

MOST_FRAMES = 300
"""Longer takes are shown by their lowest frames: nobody reads thousands of rows, and printing them takes a minute."""

LOWEST_FRAMES = 20


def print_evaluation(take: Take) -> None:
    """Print one row per frame, in a long take only those of the lowest PSNR; the means, and how they were measured."""
    evaluation = read_evaluation(take.evaluation)
    summary, protocol = evaluation.summary, evaluation.protocol
    screen = console()
    metrics = [metric for metric in evaluation.metrics if metric.narrow]
    table = table_of("frame", "group", "splats", *(metric.title for metric in metrics), "KB")

    def cells(row: Quality) -> list[str]:
        texts = metric_texts(row, metrics)
        return ["/".join(pair) for pair in zip(texts[::2], texts[1::2], strict=True)]

    rows, left_out = evaluation.frames, ""
    if len(rows) > MOST_FRAMES:
        lowest = sorted(rows, key=lambda row: row.psnr_decoded)[:LOWEST_FRAMES]
        rows = tuple(sorted(lowest, key=lambda row: row.index))
        left_out = f"The {len(rows)} frames with the lowest PSNR, decoded, of {len(evaluation.frames):,}. "
    for row in rows:
        mark = "*" if row.starts_group else ""
        numbers = f"{row.frame}{mark}", str(row.group), str(row.splats)
        table.add_row(*numbers, *cells(row), f"{row.bytes / 1000:.1f}")
    table.add_section()
    table.add_row("mean", "", "", *cells(summary), f"{summary.bytes_per_frame / 1000:.1f}")
    screen.print(table)
    which = "held-out cameras" if protocol.held_out else f"{protocol.note} TRAINING cameras"
    screen.print(
        f"{left_out}Trained/decoded; {which} {', '.join(protocol.cameras)};  {protocol.crop}; background "
        f"{protocol.background}. * first frame of a group.\n"
        "KB of a frame: its group's files, divided by the group's frames. "
        f"KB of the mean: all {protocol.total_bytes:,} bytes, with manifest and sound, divided by all frames."
        + (f" The set has another {protocol.set_bytes:,} bytes, sent once." if protocol.set_bytes else "")
        + (f"\nLPIPS: {protocol.lpips}" if protocol.lpips else ""),
        style="dim",
        markup=False,
    )
    if evaluation.masks.words:
        screen.print(f"Wrong: {evaluation.masks.words}.", style="bold red", markup=False, soft_wrap=True)
    screen.print(f"stream: {take.stream}\nreport: {take.report}", markup=False, soft_wrap=True)


def print_playback(report: PlaybackReport) -> None:
    """Print one row per frame and statistics, in milliseconds, as the paper's table of player runtime."""
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
        f"{counted(report.shown, 'frame')} in {report.seconds:.2f} s: {report.fps:.1f} frames per second, "
        f"{report.dropped} dropped"
        + (f", {sum(group.frame_count for group in report.skipped)} damaged" if report.skipped else "")
    )


def metric_texts(row: Quality, metrics: Sequence[Metric]) -> list[str]:
    """Metrics of a row, of trained and of decoded frames, without units; "-" for those that it does not have."""
    measures = row.measures
    names = [(metric, f"{metric.name}_{what}") for metric in metrics for what in ("trained", "decoded")]
    return [metric.text(measures.get(name), unit=False) for metric, name in names]
