"""The HTML report of a take: one file with pictures and plots in it."""

from __future__ import annotations

import base64
import datetime
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines.files import read_json
from pipelines.pictures import encode
from pipelines.records import read_record
from pipelines.stages.base import Context
from pipelines.take import program_version

if TYPE_CHECKING:
    from pipelines.stages.evaluate import Sample

DIFFERENCE_GAIN = 4.0
"""Differences are shown this many times as strong, or nothing would be seen."""


def render_report(context: Context, evaluation: dict[str, Any], samples: Sequence[Sample]) -> str:
    """The whole report as text.

    Args:
        context: the take.
        evaluation: what evaluation.json holds.
        samples: pictures to show.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("pipelines", "templates"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    width = context.config.evaluate.report_width
    return environment.get_template("report.html.j2").render(
        title=context.take.root.name,
        made=datetime.datetime.now().isoformat(sep=" ", timespec="minutes"),
        version=program_version(),
        evaluation=evaluation,
        gain=DIFFERENCE_GAIN,
        pictures=[_pictures(sample, width) for sample in samples],
        quality_plot=_svg(_quality_plot, evaluation),
        size_plot=_svg(_size_plot, evaluation),
        train_plot=_svg(_train_plot, _train_seconds(context)),
        calibration=_calibration(context),
        timings=_timings(context),
        settings=context.config.model_dump(mode="json"),
    )


def _pictures(sample: Sample, width: int) -> dict[str, Any]:
    difference = np.clip(np.abs(sample.decoded - sample.truth) * DIFFERENCE_GAIN, 0, 1)
    return {
        "frame": sample.frame,
        "camera": sample.camera,
        "images": [
            (label, _embedded(image, width))
            for label, image in (
                ("filmed", sample.truth),
                ("trained", sample.trained),
                ("decoded", sample.decoded),
                (f"difference x{DIFFERENCE_GAIN:g}", difference),
            )
        ],
    }


def _embedded(image: np.ndarray, width: int) -> str:
    """A data URI, at most `width` pixels wide."""
    import cv2

    if image.shape[1] > width:
        size = (width, max(1, round(image.shape[0] * width / image.shape[1])))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return "data:image/jpeg;base64," + base64.b64encode(encode(image, ".jpg")).decode()


def _svg(draw_into: Any, data: Any) -> str:
    """A plot as SVG text, or "" where there is nothing to plot."""
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
        buffer = io.StringIO()
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _quality_plot(axes: Any, evaluation: dict[str, Any]) -> bool:
    rows = evaluation["frames"]
    frames = [row["frame"] for row in rows]
    axes.plot(frames, [row["psnr_trained"] for row in rows], "o-", markersize=3, label="trained")
    axes.plot(frames, [row["psnr_decoded"] for row in rows], "s--", markersize=3, label="decoded")
    for row in rows:
        if row["keyframe"]:
            axes.axvline(row["frame"], color="grey", alpha=0.4, linewidth=0.8)
    axes.set(xlabel="frame (grey: keyframes)", ylabel="PSNR, dB")
    axes.legend(frameon=False)
    return True


def _size_plot(axes: Any, evaluation: dict[str, Any]) -> bool:
    rows = evaluation["frames"]
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


def _train_seconds(context: Context) -> list[tuple[int, float]]:
    found: list[tuple[int, float]] = []
    for group in context.groups:
        path = context.take.train_group(group.index) / "group.json"
        if path.is_file():
            found += zip(group.frames, read_json(path)["seconds"], strict=False)
    return found


def _calibration(context: Context) -> dict[str, Any]:
    """The plain values of the calibration's report; tables by camera stay in calibrate/report.json."""
    if not context.take.calibration_report.is_file():
        return {}
    found: dict[str, Any] = {}
    for name, value in read_json(context.take.calibration_report).items():
        if isinstance(value, dict) and len(value) <= 4:
            found |= {f"{name} {key}": item for key, item in value.items() if isinstance(item, (int, float))}
        elif isinstance(value, (str, int, float)):
            found[name] = value
    return found


def _timings(context: Context) -> list[tuple[str, float]]:
    """Seconds of each stage that went before."""
    found = []
    for stage in ("calibrate", "initialise", "train", "bake"):
        record = read_record(context.take, stage)
        if record is not None:
            found.append((stage, float(record["seconds"])))
    return found
