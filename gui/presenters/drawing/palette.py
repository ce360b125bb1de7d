"""The window's colors: dark, calm, one accent. 8-bit sRGB."""

from __future__ import annotations

RGB = tuple[int, int, int]

BLACK: RGB = (8, 9, 10)
"""Outline of text and marks over images."""

GROUND: RGB = (30, 32, 36)
"""Background of the window."""

PANEL: RGB = (37, 40, 45)
"""Background of panels."""

RAISED: RGB = (49, 53, 60)
"""The selected row, tracks, borders of pictures."""

LINE: RGB = (60, 65, 73)
"""Thin lines and grids."""

TEXT: RGB = (222, 226, 232)
DIM: RGB = (140, 148, 160)
FAINT: RGB = (92, 99, 110)
"""Not for text: it lacks contrast."""

ACCENT: RGB = (86, 190, 222)
"""The accent: selection, running stages, the playhead, decoded splats."""

ACCENT_DARK: RGB = (40, 92, 112)

SECOND: RGB = (188, 193, 201)
"""The second curve of a pair."""

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
    """The same color as floats, 0 to 1."""
    return color[0] / 255, color[1] / 255, color[2] / 255
