"""The list of stages as an image: status dot, title, text, progress bar."""

from collections.abc import Sequence

import numpy as np

from gui.drawing.canvas import Canvas, text_width
from gui.drawing.palette import ACCENT, DIM, LINE, PANEL, RAISED, STATE_COLORS, TEXT
from gui.models.stage_rows import StageRow

GRIP = 0.55  # width in em of the edge that is dragged to make the panel wider or narrower


def row_height(em: float) -> float:
    """Height of a row in pixels."""
    return round(2.3 * em)


def row_at(y: float, em: float, count: int) -> int | None:
    """The row at a pixel; None if there is none."""
    row = int(y // row_height(em))
    return row if 0 <= row < count else None


def image(rows: Sequence[StageRow], selected: str, width: int, em: float) -> np.ndarray:
    """(rows * row_height, width, 3) uint8."""
    each = row_height(em)
    canvas = Canvas(width, each * len(rows), PANEL)
    size, small = round(em), round(0.82 * em)
    for number, row in enumerate(rows):
        y = number * each
        if row.key == selected:
            canvas.rect(0, y, width, each, RAISED)
            canvas.rect(0, y, 3, each, ACCENT)
        color = STATE_COLORS[row.state]
        middle = y + each / 2
        canvas.dot(1.2 * em, middle, 0.32 * em, color, filled=row.state not in ("missing", "waiting"))
        title = canvas.text(2.2 * em, middle - 0.62 * size, row.title, size, TEXT)
        room = width - 2.2 * em - title - 1.2 * em
        words = row.words
        if text_width(words, small) > room and "," in words:
            words = words.split(",")[0]
        color = color if row.state in ("failed", "running", "stale", "partial") else DIM
        canvas.text(width - 0.6 * em, middle - 0.62 * small, words, small, color, align="right", width=room)
        if row.state == "running":
            canvas.rect(2.2 * em, y + each - 4, width - 2.8 * em, 2, LINE)
            canvas.rect(2.2 * em, y + each - 4, (width - 2.8 * em) * min(max(row.fraction or 0.0, 0.0), 1.0), 2, ACCENT)
    for number in range(-1, 2):  # the edge that is dragged
        canvas.rect(width - 4, canvas.height / 2 + number * 6 - 1, 2, 2, DIM)
    return canvas.pixels
