"""The image of the points view, and what clicks on its parts do."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import cv2
import numpy as np

from v3studio.gui.drawing.areas import Areas, Box
from v3studio.gui.drawing.canvas import Canvas, fitted, line_height, text_width, wrapped
from v3studio.gui.drawing.labels import draw_labels
from v3studio.gui.drawing.palette import ACCENT, ACCENT_DARK, BAD, BLACK, DIM, FAIR, GOOD, GROUND, LINE, RAISED, TEXT
from v3studio.gui.models.playback.image_zoom import Magnifier
from v3studio.gui.pages.calibrate.marks import TieMarks
from v3studio.gui.pages.stage_view import rectangle
from v3studio.studio.calibration import TiePoint
from v3studio.studio.calibration.report import TiePointReport
from v3studio.studio.counts import counted

MOST_PICTURES = 6
_LEAST_CROP = 50
_CROP = 24  # half the size of the crops around a mark, in pixels

_HOW = (
    "Click a corner or dot that other cameras see too. Go to the next camera (C) and click the same point. "
    "Then add a new point (N). Mark a dozen points per camera, spread over the image and not all on the floor."
)

Action = Callable[[], None]
Spots = Areas[Action]  # clickable rectangles


class PointsImage:
    """The image of the points view. `camera`: whose image is on screen; `choose`: called with another camera."""

    def __init__(
        self, size: tuple[int, int], em: float, marks: TieMarks, camera: str, choose: Callable[[str], None]
    ) -> None:
        self.canvas, self.spots = Canvas(*size, GROUND), Spots()
        self._em, self._small, self._marks, self._camera, self._choose = em, round(0.85 * em), marks, camera, choose

    def tabs(self, x: float, width: float, names: Sequence[str]) -> float:
        """Draw the camera names with their numbers of marks in rows; return the y coordinate below them."""
        em, marks = self._em, self._marks
        step, left, y = round(1.65 * em), x, round(0.25 * em)
        for name in names:
            words = f"{name}  {marks.count(name)}"
            wide = text_width(words, self._small) + 0.9 * em
            if left + wide > x + width and left > x:
                left, y = x, y + step
            marked = marks.point is not None and name in marks.point.pixels
            color, ground = GOOD if marked else TEXT, ACCENT_DARK if name == self._camera else RAISED
            self.canvas.button(left, y, wide - 4, step - 4, words, self._small, ground, color, ground)
            self.spots.add((left, y, wide, step), partial(self._choose, name))
            left += wide
        return y + step + round(0.25 * em)

    def crosses(self, magnifier: Magnifier) -> None:
        """Draw all marks of the camera as crosses with an open center, and as many names as fit without overlap."""
        canvas, em, marks = self.canvas, self._em, self._marks
        seen = [index for index, point in enumerate(marks.points) if self._camera in point.pixels]
        names, shapes, colors = [], [], []
        for index in sorted(seen, key=lambda index: index != marks.chosen):
            point, chosen = marks.points[index], index == marks.chosen
            x, y = magnifier.shown(point.pixels[self._camera])
            if not magnifier.holds(x, y):
                continue
            color = ACCENT if chosen else GOOD
            for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                ends = [(x + 3 * dx, y + 3 * dy), (x + 0.6 * em * dx, y + 0.6 * em * dy)]
                canvas.line([(u + 1, v + 1) for u, v in ends], BLACK, 2 if chosen else 1)
                canvas.line(ends, color, 2 if chosen else 1)
            names.append(fitted(point.name, self._small, 12 * em))
            shapes.append(rectangle(x - 0.6 * em, y - 0.6 * em, 1.2 * em, 1.2 * em))
            colors.append(color)
        draw_labels(canvas, names, shapes, self._small, colors)

    def crops(self, rect: Box, images: Mapping[str, np.ndarray], point: TiePoint) -> None:
        """Draw magnified crops of a point in several cameras, stacked vertically."""
        canvas, small, (x, y, width, height) = self.canvas, self._small, rect
        label = line_height(small) + 4
        count = max(min(len(images), int(height // (label + _LEAST_CROP))), 1)
        side = min(width - 8, height / max(count, 3) - label)
        for name, image in list(images.items())[:count]:
            column, row = point.pixels[name]
            factor = side / (2 * _CROP)
            # OpenCV's origin is the center of the first pixel
            move = [0.5 * factor - 0.5 + (_CROP - place) * factor for place in (column, row)]
            warp = np.array([[factor, 0, move[0]], [0, factor, move[1]]])
            crop = cv2.warpAffine(image, warp, (int(side), int(side)), flags=cv2.INTER_CUBIC, borderValue=RAISED)
            canvas.image(x + 4, y, crop)
            middle = x + 4 + side / 2, y + side / 2
            for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                canvas.line([(middle[0] + k * dx, middle[1] + k * dy) for k in (4, 0.3 * side)], ACCENT)
            canvas.text(x + 4, y + side, name, small, ACCENT if name == self._camera else TEXT)
            self.spots.add((x, y, width, side), partial(self._choose, name))
            y += side + label

    def points(
        self, width: float, scroll: int, solved: Mapping[str, TiePointReport], buttons: Sequence[tuple[str, Action]]
    ) -> int:
        """Draw the points, each with its number of cameras and its error, and the buttons below. Returns the first
        visible row: the given one, or another that makes the selected point visible."""
        canvas, em, marks, height = self.canvas, self._em, self._marks, self.canvas.height
        small, pad = self._small, 0.5 * em
        step = line_height(small) + 3
        top = pad + step
        canvas.rect(0, 0, width, height, GROUND)
        high, gap = round(1.65 * em), round(0.25 * em)
        bottom = height - len(buttons) * (high + gap) - pad + gap
        rows = max(int((bottom - 1.6 * step - 2 * pad) // step), 1)
        scroll = min(max(scroll, marks.chosen - rows + 1), max(marks.chosen, 0))
        canvas.text(pad, top - step, counted(len(marks.points), "point"), small, DIM)
        if len(marks.points) < 2:
            canvas.lines(pad, top + step, wrapped(_HOW, small, width - 2 * pad)[: rows - 3], small, DIM)
        for row, index in enumerate(range(scroll, min(scroll + rows, len(marks.points)))):
            point, y = marks.points[index], top + step * row
            if index == marks.chosen:
                canvas.rect(2, y, width - 6, step - 1, ACCENT_DARK)
            error = solved[point.name].error if point.name in solved else None
            words = f"{len(point.pixels)} cam" + ("" if error is None else f"  {error:.1f} px")
            wide = text_width(words, small)
            canvas.text(pad, y + 1, point.name, small, TEXT, width=width - wide - 2.5 * pad)
            canvas.text(width - pad - 4, y + 1, words, small, _color(error, len(point.pixels)), align="right")
            self.spots.add((0, y, width, step), partial(marks.choose, index))
        for words, action in buttons:
            canvas.button(pad, bottom, width - 2 * pad - 2, high, words, small)
            self.spots.add((pad, bottom, width - 2 * pad - 2, high), action)
            bottom += high + gap
        canvas.line([(width - 2, 0), (width - 2, height)], LINE)
        return scroll


def _color(error: float | None, cameras: int) -> tuple[int, int, int]:
    if error is None:
        return TEXT if cameras > 1 else DIM
    return GOOD if error < 1 else FAIR if error < 3 else BAD
