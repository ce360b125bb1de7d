"""Ablation report: a table, and the paper's figure of PSNR against kilobytes per frame."""

import io
from pathlib import Path

from v3studio.pipelines.ablation.study import AblationResults
from v3studio.pipelines.reports.plots import figure_with_axes
from v3studio.studio.atomic_files import write_bytes
from v3studio.studio.process import plot_style


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


@plot_style()
def write_plot(results: AblationResults, path: Path) -> None:
    """Write the rate-distortion curves as PNG."""
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
    write_bytes(path, data.getvalue())
