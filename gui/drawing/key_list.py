"""The list of shortcuts as an image: two columns of sections, keys beside what they do."""

from collections.abc import Mapping

import numpy as np

from v3studio.gui.drawing.canvas import Canvas, line_height, wrapped
from v3studio.gui.drawing.palette import ACCENT, DIALOG, LINE, TEXT

KEYS = 0.36  # share of a column that the keys take


def key_list(sections: Mapping[str, Mapping[str, str]], width: int, em: float) -> np.ndarray:
    """(height, width, 3) uint8, as high as needed. `sections`: keys and what they do, by heading."""
    size, gap = round(0.78 * em), round(1.5 * em)
    column = (width - gap) / 2
    step = line_height(size)

    def lines_of(rows: Mapping[str, str]) -> list[tuple[list[str], list[str]]]:
        return [
            (wrapped(keys, size, KEYS * column - 0.5 * em), wrapped(words, size, (1 - KEYS) * column - 0.3 * em))
            for keys, words in rows.items()
        ]

    laid_out = {title: lines_of(rows) for title, rows in sections.items()}
    heights = [2.2 * em + sum(max(map(len, row)) for row in rows) * step for rows in laid_out.values()]
    count = min(range(len(heights) + 1), key=lambda number: max(sum(heights[:number]), sum(heights[number:])))
    canvas = Canvas(width, max(sum(heights[:count]), sum(heights[count:])), DIALOG)
    x = y = 0.0
    for number, (title, rows) in enumerate(laid_out.items()):
        if number == count:
            x, y = column + gap, 0.0
        canvas.text(x, y, title, round(0.95 * em), ACCENT)
        canvas.rect(x, y + 1.4 * em, column, 1, LINE)
        y += 1.7 * em
        for row in rows:
            for lines, left in zip(row, (x, x + KEYS * column), strict=True):
                canvas.lines(left, y, lines, size, TEXT)
            y += max(map(len, row)) * step
        y += 0.5 * em
    return canvas.pixels
