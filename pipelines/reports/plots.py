"""What the report shows over time: plots as SVG, and the marks."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

from pipelines.takes.atomic_files import read_json
from pipelines.takes.groups import Group
from pipelines.takes.take import Take

MARK_COLOR = "tab:red"


def plots(take: Take, groups: Sequence[Group], evaluation: dict[str, Any], marks: Mapping[int, str]) -> dict[str, str]:
    """SVG text by name: quality, size, train; "" where there is nothing to plot.

    Args:
        take: what is reported on.
        groups: its groups of frames.
        evaluation: what evaluation.json holds.
        marks: frame, counted from 0, to note.
    """
    rows = evaluation["frames"]
    marked = [row["frame"] for row in rows if row["index"] in marks]
    return {
        "quality": _svg(_quality_plot, rows, marked),
        "size": _svg(_size_plot, rows, marked),
        "train": _svg(_train_plot, _train_seconds(take, groups), marked),
    }


def mark_rows(evaluation: dict[str, Any], marks: Mapping[int, str]) -> list[dict[str, Any]]:
    """Each mark with its note and the frame's row of evaluation.json (None where the frame was not measured)."""
    rows = {row["index"]: row for row in evaluation["frames"]}
    return [{"frame": frame, "note": marks[frame], "row": rows.get(frame)} for frame in sorted(marks)]


def _svg(draw_into: Any, data: Any, marked: list[int]) -> str:
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "v3studio", "font.size": 9}):
        figure = Figure(figsize=(8, 2.6), layout="constrained")
        axes = figure.add_subplot()
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
        if not draw_into(axes, data):
            return ""
        for frame in marked:
            axes.axvline(frame, ymax=0.08, color=MARK_COLOR, linewidth=2, gid=f"mark {frame}")
        buffer = io.StringIO()
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _quality_plot(axes: Any, rows: list[dict[str, Any]]) -> bool:
    frames = [row["frame"] for row in rows]
    axes.plot(frames, [row["psnr_trained"] for row in rows], "o-", markersize=3, label="trained")
    axes.plot(frames, [row["psnr_decoded"] for row in rows], "s--", markersize=3, label="decoded")
    for row in rows:
        if row["keyframe"]:
            axes.axvline(row["frame"], color="gray", alpha=0.4, linewidth=0.8)
    axes.set(xlabel="frame (gray: keyframes; red ticks: marks)", ylabel="PSNR, dB")
    axes.legend(frameon=False)
    return True


def _size_plot(axes: Any, rows: list[dict[str, Any]]) -> bool:
    axes.step([row["frame"] for row in rows], [row["bytes"] / 1000 for row in rows], where="mid")
    axes.set(xlabel="frame", ylabel="KB a frame (mean of its group)", ylim=(0, None))
    return True


def _train_plot(axes: Any, seconds: list[tuple[int, float]]) -> bool:
    known = [(frame, value) for frame, value in seconds if value > 0]
    if not known:
        return False
    axes.bar([frame for frame, _ in known], [value for _, value in known], width=0.8)
    axes.set(xlabel="frame", ylabel="training, s")
    return True


def _train_seconds(take: Take, groups: Sequence[Group]) -> list[tuple[int, float]]:
    found: list[tuple[int, float]] = []
    for group in groups:
        path = take.train_group(group.index) / "group.json"
        if path.is_file():
            found += zip(group.frames, read_json(path)["seconds"], strict=False)
    return found
