"""Icons of buttons: characters of a small font, which the toolkit draws with the text at every scale.

The font has these icons of Lucide (ISC license, see gui/icons/LICENSE); `scripts/icon_font.py` makes it.
"""

from collections.abc import Mapping
from pathlib import Path

FONT = Path(__file__).parents[1] / "icons" / "icons.ttf"

ICONS: Mapping[str, str] = {  # name of the icon by key of the button
    # below the timeline
    "start": "skip-back",
    "back": "step-back",
    "play": "play",
    "pause": "pause",
    "forward": "step-forward",
    "end": "skip-forward",
    "reset view": "rotate-ccw",
    # rows of lists
    "row up": "chevron-up",
    "row down": "chevron-down",
    "row view": "refresh-cw",
    "row remove": "x",
}

ICON_SIZE = 1.06  # width and height of an icon in font sizes

FIRST = 0xA640
"""Code point of the first icon. Open3D 0.20 draws none of the code points given to `add_typeface_for_code_points`, but
those of languages: this is in the range of Cyrillic, in a block that only old manuscripts need."""

CODES: Mapping[str, int] = {name: FIRST + number for number, name in enumerate(sorted(set(ICONS.values())))}
"""Code points of the icons in the font. After a change, make the font again."""


def icon(key: str) -> str:
    """The character of a button's icon; "" if it has none."""
    return chr(CODES[ICONS[key]]) if key in ICONS else ""
