"""The list of shortcuts as an image: two columns of sections, keys beside what they do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gui.drawing.canvas import Canvas, line_height, wrapped
from gui.drawing.palette import ACCENT, DIALOG, LINE, TEXT

Section = tuple[str, Sequence[tuple[str, str]]]

KEYS = 0.36
"""Share of a column that the keys take."""


def key_list(sections: Sequence[Section], width: int, em: float) -> np.ndarray:
    """(height, width, 3) uint8, as high as needed.

    Args:
        sections: heading, and rows of keys and what they do.
        width: pixels.
        em: font size, pixels.
    """
    size, gap = round(0.78 * em), round(1.5 * em)
    column = (width - gap) / 2
    step = line_height(size)

    def laid_out(section: Section) -> list[tuple[list[str], list[str]]]:
        return [
            (wrapped(keys, size, KEYS * column - 0.5 * em), wrapped(words, size, (1 - KEYS) * column - 0.3 * em))
            for keys, words in section[1]
        ]

    def height(section: Section) -> float:
        return 2.2 * em + sum(max(len(keys), len(words)) for keys, words in laid_out(section)) * step

    heights = [height(section) for section in sections]
    count = min(range(len(sections) + 1), key=lambda number: max(sum(heights[:number]), sum(heights[number:])))
    canvas = Canvas(width, max(sum(heights[:count]), sum(heights[count:])), DIALOG)
    for x, part in ((0.0, sections[:count]), (column + gap, sections[count:])):
        y = 0.0
        for section in part:
            canvas.text(x, y, section[0], round(0.95 * em), ACCENT)
            canvas.rect(x, y + 1.4 * em, column, 1, LINE)
            y += 1.7 * em
            for keys, words in laid_out(section):
                for lines, left in ((keys, x), (words, x + KEYS * column)):
                    for number, line in enumerate(lines):
                        canvas.text(left, y + number * step, line, size, TEXT)
                y += max(len(keys), len(words)) * step
            y += 0.5 * em
    return canvas.pixels
