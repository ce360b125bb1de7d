"""Figures of a span of frames that was selected on the timeline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

Values = Sequence[float | None]


@dataclass(frozen=True)
class SpanFigures:
    """See the module; None where nothing was measured.

    Attributes:
        psnr: mean over the frames, dB.
        lowest: the lowest of them, dB.
        lowest_frame: the frame that has it.
        bytes: sum over the frames.
        flicker: mean over the frames, levels of 255.
    """

    psnr: float | None
    lowest: float | None
    lowest_frame: int | None
    bytes: float | None
    flicker: float | None


def span_figures(series: Mapping[str, Values], first: int, last: int, psnr: str = "psnr_decoded") -> SpanFigures:
    """Figures of the frames from `first` to `last`.

    Args:
        series: values of every frame by metric: PSNR, "bytes" and "flicker".
        first, last: frames, both inclusive.
        psnr: name of the PSNR.
    """
    inside = slice(first, last + 1)
    quality = {first + at: one for at, one in enumerate(series.get(psnr, ())[inside]) if one is not None}
    lowest = min(quality, key=lambda frame: quality[frame], default=None)
    sizes = [one for one in series.get("bytes", ())[inside] if one is not None]
    flicker = [one for one in series.get("flicker", ())[inside] if one is not None]
    return SpanFigures(
        sum(quality.values()) / len(quality) if quality else None,
        quality[lowest] if lowest is not None else None,
        lowest,
        sum(sizes) if sizes else None,
        sum(flicker) / len(flicker) if flicker else None,
    )


def span_rows(figures: SpanFigures, other: SpanFigures | None = None) -> list[tuple[str, str]]:
    """(name, value) of each figure that is known; the other bake's after a slash."""
    against = other or SpanFigures(None, None, None, None, None)

    def words(form: str, unit: str, one: float | None, two: float | None, scale: float = 1.0) -> str:
        parts = ["-" if value is None else form.format(value * scale) for value in (one, two)]
        return f"{' / '.join(parts if other is not None else parts[:1])} {unit}"

    at = "" if figures.lowest_frame is None else f", frame {figures.lowest_frame}"
    found = (
        ("PSNR, mean", figures.psnr, against.psnr, words("{:.2f}", "dB", figures.psnr, against.psnr)),
        (f"lowest{at}", figures.lowest, against.lowest, words("{:.2f}", "dB", figures.lowest, against.lowest)),
        ("size", figures.bytes, against.bytes, words("{:,.1f}", "KB", figures.bytes, against.bytes, 1e-3)),
        ("flicker", figures.flicker, against.flicker, words("{:.2f}", "/255", figures.flicker, against.flicker)),
    )
    return [(name, text) for name, one, two, text in found if one is not None or two is not None]
