import pytest

from v3studio.gui.drawing import palette
from v3studio.gui.drawing.palette import RGB


def luminance(color: RGB) -> float:
    """Relative luminance of WCAG 2.2."""
    parts = [part / 255 for part in color]
    linear = [value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4 for value in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(first: RGB, second: RGB) -> float:
    """Contrast ratio of WCAG 2.2."""
    darker, lighter = sorted((luminance(first), luminance(second)))
    return (lighter + 0.05) / (darker + 0.05)


TEXTS = (palette.TEXT, palette.DIM, palette.ACCENT, palette.SECOND, palette.GOOD, palette.FAIR, palette.BAD)
GROUNDS = (palette.GROUND, palette.PANEL, palette.RAISED, palette.DIALOG)
PAIRS = (
    *((text, ground) for text in TEXTS for ground in GROUNDS),
    (palette.TEXT, palette.ACCENT_DARK),
    (palette.TEXT, palette.BLACK),
    *((palette.GROUND, axis) for axis in palette.AXES),
)
"""Colors of text, and of what it is drawn on."""


@pytest.mark.parametrize(("text", "ground"), PAIRS, ids=lambda pair: "")
def test_texts_have_the_contrast_of_level_aa(text: RGB, ground: RGB) -> None:
    assert contrast(text, ground) >= 4.5


@pytest.mark.parametrize("state", [state for state in palette.STATE_COLORS if state not in ("missing", "waiting")])
def test_dots_and_curves_have_the_contrast_of_graphics(state: str) -> None:
    """WCAG 2.2, 1.4.11; a stage that is missing or waiting has a ring, and a word beside it."""
    for color in (palette.STATE_COLORS[state], *palette.SERIES):
        assert contrast(color, palette.RAISED) >= 3
