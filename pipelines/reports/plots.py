"""Timeline plots (SVG) and the table of marks in the report."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.evaluation import Evaluation, FrameQuality
from v3studio.pipelines.takes.results.stage_files import TrainedGroup
from v3studio.pipelines.takes.take import Take
from v3studio.studio.comparison.metrics import FLICKER
from v3studio.studio.process import plot_style

MARK_COLOR = "tab:red"


def plots(take: Take, groups: Sequence[Group], evaluation: Evaluation, marks: Mapping[int, str]) -> dict[str, str]:
    """SVG by name: quality, flicker, size, train; "" if there is nothing to plot. `marks`: notes by frame number."""
    rows = evaluation.frames
    marked = [row.frame for row in rows if row.frame in marks]
    return {
        "quality": _svg(_quality_plot, rows, marked),
        "flicker": _svg(_flicker_plot, rows, marked),
        "size": _svg(_size_plot, rows, marked),
        "train": _svg(_train_plot, _train_seconds(take, groups), marked),
    }


def figure_with_axes(width: float, height: float) -> tuple[Any, Any]:
    """A matplotlib figure of this size in inches, and its axes: the look of all plots in reports."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    # margins in inches; finding the smallest ones would draw everything twice
    axes = figure.add_axes((0.8 / width, 0.45 / height, 1 - 0.9 / width, 1 - 0.55 / height))
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)
    return figure, axes


@plot_style(svg_fonttype="none", svg_hashsalt="v3studio", font_size=9)
def _svg(plot_into: Any, data: Any, marked: list[int]) -> str:
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    figure, axes = figure_with_axes(8, 2.6)
    if not plot_into(axes, data):
        return ""
    for frame in marked:
        axes.axvline(frame, ymax=0.08, color=MARK_COLOR, linewidth=2, gid=f"mark {frame}")
    buffer = io.StringIO()
    FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _quality_plot(axes: Any, rows: Sequence[FrameQuality]) -> bool:
    frames = [row.frame for row in rows]
    axes.plot(frames, [row.psnr_trained for row in rows], "o-", markersize=3, label="trained")
    axes.plot(frames, [row.psnr_decoded for row in rows], "s--", markersize=3, label="decoded")
    _plot_borders(axes, rows)
    axes.set(xlabel="frame (gray: group borders; red ticks: marks)", ylabel="PSNR (dB)")
    axes.legend(frameon=False, loc="best" if len(rows) <= 1000 else "upper right")  # the best place takes long to find
    return True


def _flicker_plot(axes: Any, rows: Sequence[FrameQuality]) -> bool:
    known = [(row.frame, row.flicker) for row in rows if row.flicker is not None]
    if not known:
        return False
    axes.plot([frame for frame, _ in known], [value for _, value in known], "o-", markersize=3)
    _plot_borders(axes, rows)
    axes.set(xlabel="frame (gray: group borders)", ylabel=f"{FLICKER.title} ({FLICKER.unit})", ylim=(0, None))
    return True


def _plot_borders(axes: Any, rows: Sequence[FrameQuality]) -> None:
    for row in rows:
        if row.starts_group:
            axes.axvline(row.frame, color="gray", alpha=0.4, linewidth=0.8)


def _size_plot(axes: Any, rows: Sequence[FrameQuality]) -> bool:
    axes.step([row.frame for row in rows], [row.bytes / 1000 for row in rows], where="mid")
    axes.set(xlabel="frame", ylabel="KB per frame (mean of its group)", ylim=(0, None))
    return True


def _train_plot(axes: Any, seconds: list[tuple[int, float]]) -> bool:
    if not seconds:
        return False
    axes.bar(*zip(*seconds, strict=True), width=0.8)
    axes.set(xlabel="frame", ylabel="training time (s)")
    return True


def _train_seconds(take: Take, groups: Sequence[Group]) -> list[tuple[int, float]]:
    found: list[tuple[int, float]] = []
    for group in groups:
        path = take.train_group(group.index) / "group.json"
        if path.is_file():
            trained = read_model(path, TrainedGroup)
            share = trained.joint_seconds / len(group.frames)
            found += [(frame, own + share) for frame, own in zip(group.frames, trained.seconds, strict=False) if own]
    return found
