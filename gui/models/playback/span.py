"""Figures of a span of frames that was selected on the timeline."""

from collections.abc import Callable, Mapping, Sequence
from statistics import fmean

from studio.comparison.metrics import FLICKER, MAIN

Series = Mapping[str, Sequence[float | None]]

QUALITY = f"{MAIN.name}_decoded"
SPANNED = (QUALITY, "bytes", FLICKER.name)  # what the figures are made of


def span_rows(
    series: Series, first: int, last: int, other: Series | None = None, number: Callable[[int], int] = int
) -> list[tuple[str, str]]:
    """(name, value) of each figure of the frames from `first` to `last` that is known, from the values of every frame
    by name of `SPANNED`, None where nothing was measured; figures of `other`, with which it is compared, follow a
    slash."""
    frames = slice(first, last + 1)
    measured = [(value, first + at) for at, value in enumerate(series.get(QUALITY, ())[frames]) if value is not None]
    where = f", frame {number(min(measured)[1])}" if measured else ""
    quality, flicker = f".{MAIN.digits}f", f".{FLICKER.digits}f"
    figures: tuple[tuple[str, str, Callable[[list[float]], float], str, str], ...] = (
        (f"{MAIN.title}, mean", QUALITY, fmean, quality, MAIN.unit),
        (f"lowest{where}", QUALITY, min, quality, MAIN.unit),
        ("size", "bytes", lambda sizes: sum(sizes) / 1000, ",.1f", "KB"),
        (FLICKER.title, FLICKER.name, fmean, flicker, "/255"),
    )
    rows = []
    for title, name, figure, form, unit in figures:
        known = [
            [value for value in one.get(name, ())[frames] if value is not None]
            for one in (series, other)
            if one is not None
        ]
        if any(known):
            words = (format(figure(values), form) if values else "-" for values in known)
            rows.append((title, f"{' / '.join(words)} {unit}"))
    return rows
