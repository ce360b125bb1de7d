"""Contrast of the window's texts."""

from __future__ import annotations

import pytest

from gui.presenters.drawing import palette
from gui.presenters.drawing.palette import RGB


def luminance(color: RGB) -> float:
    """Relative luminance of WCAG 2.2."""
    linear = [value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4 for value in palette.unit(color)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("ground", ["GROUND", "PANEL"])
@pytest.mark.parametrize("text", ["TEXT", "DIM", "ACCENT", "SECOND", "GOOD", "FAIR", "BAD"])
def test_texts_have_the_contrast_of_level_aa(text: str, ground: str) -> None:
    lighter, darker = luminance(getattr(palette, text)), luminance(getattr(palette, ground))
    assert (lighter + 0.05) / (darker + 0.05) >= 4.5
