"""Figures of a run as words with units, for the log."""

from collections.abc import Callable, Mapping

from v3studio.gui.drawing.compare import What
from v3studio.gui.models.stage_rows import stage_name
from v3studio.pipelines.events import Metrics
from v3studio.pipelines.reports.terminal import duration
from v3studio.studio.comparison.metrics import EVALUATED
from v3studio.studio.counts import counted, size_words
from v3studio.studio.json_types import JsonData

_FIGURES: Mapping[str, Callable[[float], str]] = {  # by name, in the order of the words
    "points": lambda count: counted(count, "point"),
    "faces": lambda count: f"mesh of {counted(count, 'triangle')}",
    "frames": lambda count: counted(count, "frame"),
    "splats": lambda count: counted(count, "splat"),
    "bytes": size_words,
    "seconds": duration,
}


def metrics_words(event: Metrics) -> str:
    """One line, for example "Train, frame 12: 35,871 splats, 4 s"."""
    figures = event.values
    words = [form(value) for name, form in _FIGURES.items() if isinstance(value := figures.get(name), int | float)]
    words += _mask_words(figures.get("disagreement"))
    for metric in EVALUATED:
        for kind in (What.TRAINED, What.DECODED):
            value = figures.get(f"{metric.name}_{kind}")
            if isinstance(value, int | float):
                words.append(f"{metric.title} {metric.text(value)} {kind}")
    where = f"group {event.group}" if event.frame is None else f"frame {event.frame}"
    return f"{stage_name(event.stage)}, {where}: {', '.join(words)}"


def _mask_words(disagreement: JsonData) -> list[str]:
    """Return how much the masks of the worst camera differ from the hull; nothing if that is not known."""
    cameras = disagreement if isinstance(disagreement, Mapping) else {}
    shares = [(value, name) for name, value in cameras.items() if isinstance(value, int | float)]
    return [f"masks differ from the hull by up to {value:.0%} (camera {name})" for value, name in sorted(shares)[-1:]]
