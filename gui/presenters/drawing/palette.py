"""The window's colors: dark, calm, one accent. 8-bit sRGB."""

from __future__ import annotations

RGB = tuple[int, int, int]

BLACK: RGB = (8, 9, 10)
"""Around what must be read over any picture."""

GROUND: RGB = (30, 32, 36)
"""Behind everything."""

PANEL: RGB = (37, 40, 45)
"""Panels left, right and below."""

RAISED: RGB = (49, 53, 60)
"""The selected row, tracks, frames of pictures."""

LINE: RGB = (60, 65, 73)
"""Thin lines and grids."""

TEXT: RGB = (222, 226, 232)
DIM: RGB = (140, 148, 160)
FAINT: RGB = (92, 99, 110)

ACCENT: RGB = (86, 190, 222)
"""The one accent: what is selected, what runs, where the frame head stands, what was decoded."""

ACCENT_DARK: RGB = (40, 92, 112)

SECOND: RGB = (188, 193, 201)
"""The other curve of a pair, which is not the accent's."""

GOOD: RGB = (120, 184, 132)
FAIR: RGB = (222, 178, 92)
BAD: RGB = (222, 110, 102)

STATE_COLORS: dict[str, RGB] = {
    "done": GOOD,
    "partial": FAIR,
    "stale": FAIR,
    "failed": BAD,
    "missing": FAINT,
    "running": ACCENT,
    "waiting": ACCENT_DARK,
}


def unit(color: RGB) -> tuple[float, float, float]:
    """The same as floats in 0 to 1."""
    return color[0] / 255, color[1] / 255, color[2] / 255
