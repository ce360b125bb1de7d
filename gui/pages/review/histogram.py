"""A histogram of the splats' opacities beside the image, with the limit of floaters as a line that can be dragged."""

import numpy as np

from v3studio.gui.drawing.canvas import Canvas
from v3studio.gui.drawing.palette import DIM, FAIR, GROUND, LINE, SECOND, TEXT

BINS = 50
LEAST, MOST = 0.005, 1.0  # limits that can be dragged to; 0 is not one
_WIDTH, _HEIGHT, _MARGIN = 17.0, 7.5, 0.6  # of the whole panel and around it, em


class HistogramPlace:
    """The place of the bars: the lower left corner of an image of some size (width, height), pixels."""

    def __init__(self, size: tuple[int, int], em: float) -> None:
        self.em, self.left, self.height = em, (_MARGIN + 0.6) * em, (_HEIGHT - 3.4) * em
        self.top = size[1] - (_MARGIN + 1.6) * em - self.height
        self.width = max(min(_WIDTH * em, size[0] - 2 * _MARGIN * em) - 1.2 * em, 1.0)

    def opacity_at(self, x: float) -> float:
        """The limit at a column of the image."""
        return round(min(max((x - self.left) / self.width, LEAST), MOST), 3)

    def holds(self, x: float, y: float) -> bool:
        """Whether a pixel is on the bars or their axis."""
        return (
            -0.5 * self.em <= x - self.left <= self.width + 0.5 * self.em
            and -0.5 * self.em <= y - self.top <= self.height + 1.5 * self.em
        )


def draw_histogram(canvas: Canvas, place: HistogramPlace, opacities: np.ndarray, limit: float | None) -> None:
    """Draw the (logarithmic) bars of opacities (N,); those below `limit`, the opacity of floaters, look selected."""
    counts, below = np.histogram(opacities, BINS, (0.0, 1.0))[0], int((opacities < (limit or 0.0)).sum())
    em, size = place.em, round(0.8 * place.em)
    canvas.rect(place.left - 0.6 * em, place.top - 1.8 * em, place.width + 1.2 * em, place.height + 3.4 * em, GROUND)
    canvas.text(place.left, place.top - 1.6 * em, "Highest opacity of the splats", size, TEXT, width=place.width)
    most = np.log1p(max(int(counts.max()), 1))
    wide = place.width / BINS
    for number, count in enumerate(counts):
        high = place.height * float(np.log1p(count) / most)
        color = FAIR if limit is not None and (number + 0.5) / BINS < limit else SECOND
        if count:
            canvas.rect(place.left + number * wide, place.top + place.height - high, wide - 1, max(high, 1), color)
    bottom = place.top + place.height
    canvas.rect(place.left, bottom, place.width, 1, LINE)
    canvas.text(place.left, bottom + 0.2 * em, "0", size, DIM)
    canvas.text(place.left + place.width, bottom + 0.2 * em, "1", size, DIM, align="right")
    words = "drag a limit"
    if limit is not None:
        at = place.left + limit * place.width
        canvas.rect(at - 1, place.top - 0.3 * em, 2, place.height + 0.3 * em, FAIR)
        words = f"below {limit:g}: {below:,}"
    canvas.text(place.left + place.width / 2, bottom + 0.2 * em, words, size, FAIR if limit else DIM, align="middle")
