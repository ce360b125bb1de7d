"""Residuals of the evaluation's views, kept from one frame to the next to measure flicker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from studio.comparison import flicker


@dataclass(frozen=True, eq=False)
class Residual:
    """Decoded minus footage in the box of a view.

    Attributes:
        box: rows and columns of the image.
        values: (h, w, 3) float16, colors in 0 to 1.
    """

    box: tuple[slice, slice]
    values: np.ndarray


def flicker_of(before: Mapping[str, Residual], now: Mapping[str, Residual]) -> float | None:
    """Flicker between two consecutive frames where the boxes overlap, mean over cameras, in levels of 0 to 255.

    Args:
        before, now: by camera.

    Returns:
        None if no camera has the performer in both frames.
    """
    found = []
    for camera in sorted(set(before) & set(now)):
        one, other = before[camera], now[camera]
        spans = [(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(one.box, other.box, strict=True)]
        if all(start < stop for start, stop in spans):
            parts = []
            for each in (one, other):
                rows, columns = (
                    slice(start - side.start, stop - side.start)
                    for (start, stop), side in zip(spans, each.box, strict=True)
                )
                parts.append(each.values[rows, columns].astype(np.float32))
            found.append(flicker(*parts))
    return round(sum(found) / len(found), 4) if found else None
