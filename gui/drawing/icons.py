"""Icons of buttons: characters of a small font, which the toolkit draws with the text at every scale.

The font has these icons of Lucide (ISC license, see gui/icons/LICENSE); `scripts/icon_font.py` makes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

FONT = Path(__file__).parents[1] / "icons" / "icons.ttf"

ICONS: Mapping[str, str] = {
    # Capture, Calibrate, Initialize, Train, Bake
    "mask overlay": "layers",
    "images": "image",
    "performer": "person-standing",
    "evidence": "radar",
    "garbage masks": "pentagon",
    "cameras": "camera",
    "coverage": "radar",
    "report": "table",
    "points by hand": "mouse-pointer-click",
    "mesh": "pyramid",
    "points": "chart-scatter",
    "progress": "chart-line",
    "camera colors": "contrast",
    "bytes": "chart-column",
    "try other QPs": "chart-spline",
    # Review and the scene
    "footage": "film",
    "trained": "sparkles",
    "decoded": "binary",
    "other": "layers-2",
    "side by side": "columns-2",
    "wipe": "square-split-horizontal",
    "difference": "contrast",
    "scene": "box",
    "edit": "scissors",
    "splats": "sparkles",
    "grid": "grid-3x3",
    "axes": "axis-3d",
    "volume": "square-dashed",
    # edits
    "done": "check",
    "in": "arrow-right-from-line",
    "out": "arrow-right-to-line",
    "look": "rotate-3d",
    "crop": "crop",
    "ground": "align-vertical-justify-end",
    "floaters": "wind",
    "lasso": "lasso",
    "brush": "paintbrush",
    "remove": "trash-2",
    "origin": "crosshair",
    "up": "move-up",
    "scale": "ruler",
    "detail": "radar",
    "numbers": "hash",
    "list": "list",
    "removed": "eye",
    # below the timeline
    "start": "skip-back",
    "back": "step-back",
    "play": "play",
    "pause": "pause",
    "forward": "step-forward",
    "end": "skip-forward",
    "background": "sun-moon",
    "reset view": "rotate-ccw",
    # rows of lists
    "row up": "chevron-up",
    "row down": "chevron-down",
    "row view": "refresh-cw",
    "row remove": "x",
}
"""Name of the icon by key of the button."""

ICON_SIZE = 1.06
"""Width and height of an icon in font sizes."""

FIRST = 0xA640
"""Code point of the first icon. Open3D 0.20 draws none of the code points given to `add_typeface_for_code_points`, but
those of languages: this is in the range of Cyrillic, in a block that only old manuscripts need."""

CODES: Mapping[str, int] = {name: FIRST + number for number, name in enumerate(sorted(set(ICONS.values())))}
"""Code points of the icons in the font. After a change, make the font again."""


def icon(key: str) -> str:
    """The character of a button's icon; "" if it has none."""
    return chr(CODES[ICONS[key]]) if key in ICONS else ""
