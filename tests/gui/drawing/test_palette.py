"""Contrast of the window's texts."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from gui.drawing import palette
from gui.drawing.palette import RGB


def luminance(color: RGB) -> float:
    """Relative luminance of WCAG 2.2."""
    linear = [value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4 for value in palette.unit(color)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: RGB, other: RGB) -> float:
    """Contrast ratio of WCAG 2.2."""
    darker, lighter = sorted((luminance(one), luminance(other)))
    return (lighter + 0.05) / (darker + 0.05)


@pytest.mark.parametrize(("text", "ground"), [pair[1:] for pair in palette.TEXT_PAIRS], ids=lambda pair: "")
def test_texts_have_the_contrast_of_level_aa(text: RGB, ground: RGB) -> None:
    assert contrast(text, ground) >= 4.5


@pytest.mark.parametrize("state", [state for state in palette.STATE_COLORS if state not in ("missing", "waiting")])
def test_dots_and_curves_have_the_contrast_of_graphics(state: str) -> None:
    """WCAG 2.2, 1.4.11; a stage that is missing or waiting has a ring, and a word beside it."""
    for color in (palette.STATE_COLORS[state], *palette.SERIES):
        assert contrast(color, palette.RAISED) >= 3


def test_the_pairs_are_those_that_are_drawn() -> None:
    """Text drawn with `Canvas.text` names its color; each such color is in a pair, so that its contrast is checked."""
    root = Path(palette.__file__).parents[2]
    drawn = set()
    for path in sorted(root.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "text":
                names = (one for part in node.args for one in ast.walk(part) if isinstance(one, ast.Name))
                drawn |= {one.id for one in names if hasattr(palette, one.id)}
    paired = {name.split(" on ")[0] for name, _, _ in palette.TEXT_PAIRS}
    assert {"TEXT", "DIM"} <= drawn
    # black only outlines texts, and level AA asks nothing of buttons that cannot be pressed
    assert drawn - {"BLACK", "FAINT"} <= paired, drawn - paired
