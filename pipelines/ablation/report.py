"""Ablation report: a table, and the paper's figure of PSNR against kilobytes per frame."""

import base64
import html
import io
from pathlib import Path

from pipelines.ablation.study import AblationResults
from pipelines.reports.plots import figure_with_axes
from pipelines.takes.atomic_files import write_bytes, write_text
from studio.counts import counted


def table_rows(results: AblationResults, qp: int) -> list[list[str]]:
    """A header row, and one row per variant: values at `qp`, and over the whole curve."""
    rows = [["variant", f"KB per frame at QP {qp}", "PSNR trained", "PSNR decoded", "BD-rate", "BD-PSNR"]]
    perceptual = any(point.lpips_decoded is not None for entry in results.variants for point in entry.points)
    if perceptual:
        rows[0].insert(4, "LPIPS decoded")
    for index, entry in enumerate(results.variants):
        point = next((point for point in entry.points if point.qp == qp), None)
        figures = ["", "", ""]
        if point is not None:
            figures = [f"{point.kb_per_frame:.1f}", _fixed(point.psnr_trained, 2), f"{point.psnr_decoded:.2f}"]
        if perceptual:
            figures.append("" if point is None else _fixed(point.lpips_decoded, 4))
        against = ["", ""]
        if index:
            rate, quality = entry.bd_rate_percent, entry.bd_psnr_db
            against = [
                "no overlap" if rate is None else f"{rate:+.1f}%",
                "" if quality is None else f"{quality:+.2f} dB",
            ]
        rows.append([entry.title, *figures, *against])
    return rows


def _fixed(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def write_report(results: AblationResults, qp: int, folder: Path) -> None:
    """Write ablation.png, the rate-distortion curves, and ablation.html with the protocol, the plot and the table."""
    plot = _plot(results)
    write_bytes(folder / "ablation.png", plot)
    protocol = results.protocol
    sentences = []
    if protocol is not None:
        sentences = [
            f"{'Held-out' if protocol.held_out else 'Training'} cameras {', '.join(protocol.cameras)}",
            ", ".join(f"{name} {size[0]}x{size[1]}" for name, size in protocol.resolution.items()),
            counted(len(protocol.frames), "frame"),
            protocol.crop,
            f"background {list(protocol.background)}",
            f"bytes: {protocol.total_bytes_are}",
        ]
    header, *rows = table_rows(results, qp)
    body = "".join(f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    picture = base64.b64encode(plot).decode()
    write_text(
        folder / "ablation.html",
        "<!doctype html><meta charset=utf-8><title>Ablation</title>"
        "<style>body{font:15px system-ui;margin:2rem auto;max-width:60rem;color:#222}td,th{padding:.3rem .8rem;"
        "text-align:right}td:first-child,th:first-child{text-align:left}tr:nth-child(even){background:#f3f3f3}</style>"
        f"<h1>Ablation</h1><p>{html.escape('; '.join(sentences))}.</p>"
        f"<img style='max-width:100%' alt='PSNR against kilobytes per frame' src='data:image/png;base64,{picture}'>"
        f"<table><tr>{''.join(f'<th>{html.escape(cell)}</th>' for cell in header)}</tr>{body}</table>"
        "<p>BD-rate: mean size difference from the first row at equal decoded PSNR; negative means smaller.</p>",
    )


def _plot(results: AblationResults) -> bytes:
    figure, axes = figure_with_axes(9, 5.5)
    for index, entry in enumerate(results.variants):
        points = sorted((point.kb_per_frame, point.psnr_decoded) for point in entry.points)
        axes.plot(
            [rate for rate, _ in points],
            [quality for _, quality in points],
            marker="o",
            markersize=4,
            linewidth=2.5 if index == 0 else 1.2,
            zorder=3 if index == 0 else 2,
            label=entry.title,
        )
    axes.set_xlabel("KB per frame")
    axes.set_ylabel("PSNR of the decoded stream (dB)")
    axes.legend(fontsize=8, loc="lower right")
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=130)
    return data.getvalue()
