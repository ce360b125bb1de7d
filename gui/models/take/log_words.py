"""Figures of a run as words with units, for the log."""

from collections.abc import Callable, Mapping

from gui.models.stages import STAGES
from pipelines.events import Metrics
from pipelines.reports.terminal import duration
from studio.comparison.metrics import EVALUATED
from studio.counts import counted, size_words
from studio.json_types import JsonData

Figures = dict[str, JsonData]


def stage_name(stage: str) -> str:
    """A stage as the window names it, by its name on the command line: "Train"."""
    return next((one.title for one in STAGES if one.name == stage), stage[:1].upper() + stage[1:])


def metrics_words(event: Metrics) -> str:
    """One line, for example "Train, frame 12: 35,871 splats, 4 s". Figures that are not known here keep their names."""
    figures = dict(event.values)
    known = [part for part in _WORDS.get(event.stage, lambda _figures: [])(figures) if part]
    rest = [f"{name.replace('_', ' ')} {_plain(value)}" for name, value in figures.items() if value is not None]
    words = ", ".join([*known, *rest])
    where = f"frame {event.frame}" if event.frame is not None else f"group {event.group}"
    return f"{stage_name(event.stage)}{f', {where}' if event.group is not None else ''}: {words}"


def _calibrate(figures: Figures) -> list[str]:
    mean, p95, ratio = (
        figures.pop(name, None) for name in ("reprojection_mean", "reprojection_p95", "match_inlier_ratio")
    )
    figures.pop("reprojection_median", None)
    cameras = figures.pop("cameras", None)
    error = f"mean reprojection error {mean:.2f} px" if isinstance(mean, int | float) else ""
    spread = f" (95% below {p95:.2f} px)" if error and isinstance(p95, int | float) else ""
    return [
        _count(len(cameras), "camera") if isinstance(cameras, Mapping) else "",
        error + spread,
        _count(figures.pop("points", None), "point"),
        f"{ratio:.0%} of the matches agree" if isinstance(ratio, int | float) else "",
    ]


def _initialize(figures: Figures) -> list[str]:
    points, faces, apart = (figures.pop(name, None) for name in ("points", "faces", "disagreement"))
    found = (
        {name: one for name, one in apart.items() if isinstance(one, int | float)} if isinstance(apart, Mapping) else {}
    )
    worst = max(found, key=lambda name: found[name], default="")
    return [
        _count(points, "point"),
        f"mesh of {_count(faces, 'triangle')}" if faces is not None else "",
        f"masks differ from the hull by up to {found[worst]:.0%} (camera {worst})" if worst else "",
    ]


def _train(figures: Figures) -> list[str]:
    figures.pop("index", None)
    seconds = figures.pop("seconds", None)
    return [_count(figures.pop("splats", None), "splat"), duration(seconds) if isinstance(seconds, int | float) else ""]


def _bake(figures: Figures) -> list[str]:
    size = figures.pop("bytes", None)
    return [
        _count(figures.pop("frames", None), "frame"),
        _count(figures.pop("splats", None), "splat"),
        size_words(size) if isinstance(size, int | float) else "",
    ]


def _evaluate(figures: Figures) -> list[str]:
    words = []
    for metric in EVALUATED:
        for kind in ("trained", "decoded"):
            value = figures.pop(f"{metric.name}_{kind}", None)
            if isinstance(value, int | float):
                words.append(f"{metric.title} {metric.text(value)} {kind}")
    return words


_WORDS: Mapping[str, Callable[[Figures], list[str]]] = {
    "calibrate": _calibrate,
    "initialize": _initialize,
    "train": _train,
    "bake": _bake,
    "evaluate": _evaluate,
}


def _count(value: JsonData, noun: str) -> str:
    return counted(value, noun) if isinstance(value, int | float) else ""


def _plain(value: JsonData) -> str:
    if isinstance(value, Mapping):
        return f"of {len(value)}"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
