"""Compares images of the same view: side by side, wipe, difference heat map."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from v3studio.gui.drawing.canvas import Canvas, fitted, text_width
from v3studio.gui.drawing.palette import ACCENT, GROUND, RGB, TEXT


class Mode(StrEnum):
    """The way in which Review shows what is chosen."""

    SINGLE = "single"
    SIDE_BY_SIDE = "side by side"
    WIPE = "wipe"
    DIFFERENCE = "difference"
    SCENE = "scene"


ALONE = (Mode.SINGLE, Mode.SCENE)  # modes that compare nothing


class What(StrEnum):
    """The images of Review; each is the name of the frames' source, except for footage."""

    FOOTAGE = "footage"
    TRAINED = "trained"
    DECODED = "decoded"
    OTHER = "other"


UNDER = 0.4  # brightness of the image under a heat map
HEAT_TOP = 48  # difference in 8-bit levels at the top of the heat map's scale
LABEL_SIZE = 14  # size of texts unless another is given, pixels
LEAST_SIZE = 9  # of texts of images that are enlarged to the window: smaller ones cannot be read
GAP = 4  # pixels between images


@dataclass(frozen=True)
class Box:
    """Rectangle of an image within the viewport's image, in pixels."""

    x: int
    y: int
    width: int
    height: int

    def holds(self, x: float, y: float) -> bool:
        """Whether a pixel is in it."""
        return self.x <= x < self.x + self.width and self.y <= y < self.y + self.height

    def middle(self, size: tuple[int, int]) -> list[float]:
        """Its middle, 0 to 1 across and down an image of a size (width, height)."""
        return [round((self.x + self.width / 2) / size[0], 4), round((self.y + self.height / 2) / size[1], 4)]


def boxes(size: tuple[int, int], count: int, shape: float, label: int = 0) -> list[Box]:
    """Equal boxes in rows that fill an image, for what is `shape` (width by height) and as large as possible. `label`:
    pixels below each for its name, which is right below it."""

    def of(columns: int) -> tuple[int, int]:
        rows = -(-count // columns)
        return max((size[0] - GAP * (columns - 1)) // columns, 1), max((size[1] - GAP * (rows - 1)) // rows, 1)

    columns = max(range(count, 0, -1), key=lambda columns: min(of(columns)[0] / shape, of(columns)[1] - label))
    width, height = of(columns)
    height = min(height, round(width / shape) + label) if label else height
    return [
        Box(number % columns * (width + GAP), number // columns * (height + GAP), width, height)
        for number in range(count)
    ]


def side_by_side(
    size: tuple[int, int],
    where: Sequence[Box],
    images: Sequence[np.ndarray],
    names: Sequence[str],
    text: int = LABEL_SIZE,
    corner: tuple[int, int] = (0, 0),
) -> np.ndarray:
    """Draw images side by side, each with its label, in letters of `text` pixels at its `corner`: the column and row
    where what is filmed begins."""
    canvas = Canvas(*size)
    for box, image, name in zip(where, images, names, strict=True):
        canvas.image(box.x, box.y, image)
        x, y = _corner(box, text)
        label(canvas, x + corner[0], y + corner[1], name, size=text, width=box.x + box.width - x - corner[0])
    return canvas.pixels


def wipe(
    size: tuple[int, int], box: Box, left: np.ndarray, right: np.ndarray, at: float, names: tuple[str, str], text: int
) -> np.ndarray:
    """Draw one image to the left of the line, the other to the right. `at`: the line, 0 to 1 across the box."""
    canvas = Canvas(*size)
    column = round(min(max(at, 0.0), 1.0) * box.width)
    canvas.image(box.x, box.y, left[:, :column])
    canvas.image(box.x + column, box.y, right[:, column:])
    thick = text / LABEL_SIZE
    canvas.rect(box.x + column - thick, box.y, 2 * thick, box.height, ACCENT)
    canvas.rect(box.x + column - 4 * thick, box.y + box.height / 2 - 16 * thick, 8 * thick, 32 * thick, ACCENT)
    x, y = _corner(box, text)
    half = box.x + box.width / 2 - x
    label(canvas, x, y, names[0], size=text, width=half)
    label(canvas, 2 * box.x + box.width - x, y, names[1], align="right", size=text, width=half)
    return canvas.pixels


def difference(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(H, W) float32: absolute difference, averaged over the channels, in 8-bit levels."""
    return np.abs(left.astype(np.int16) - right).astype(np.float32).mean(axis=2)


def heat(levels: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: black through violet and orange to pale yellow at `HEAT_TOP` levels (Matplotlib's inferno)."""
    scaled = np.clip(levels * (255 / HEAT_TOP), 0, 255).astype(np.uint8)
    return np.ascontiguousarray(cv2.applyColorMap(scaled, cv2.COLORMAP_INFERNO)[..., ::-1])


def mean_difference(left: np.ndarray, right: np.ndarray, background: Sequence[float]) -> float:
    """The mean of `difference` over the pixels that show something in either image, so that it does not depend on how
    much background is in view; 0.0 without any. `background`: its color, 0 to 1."""
    empty = (np.round(255 * np.asarray(background)), np.array(GROUND))
    differ = [[np.abs(image - color).max(2) > 1 for color in empty] for image in (left, right)]
    shown = np.all(differ, axis=1).any(axis=0)
    return float(difference(left, right)[shown].mean()) if shown.any() else 0.0


def heat_map(
    size: tuple[int, int],
    box: Box,
    left: np.ndarray,
    right: np.ndarray,
    names: tuple[str, str],
    text: int,
    background: Sequence[float],
    under: np.ndarray | None,
) -> np.ndarray:
    """Draw a heat map of the difference, with a scale and its mean: `mean_difference`, or of all that is seen over
    `under`, an image in dark gray under the map. `text`: size of labels, pixels."""
    levels = difference(left, right)
    canvas = Canvas(*size)
    if under is None:
        shown, where, mean_level = heat(levels), " on the performer", mean_difference(left, right, background)
    else:
        shown = np.maximum(heat(levels), (UNDER * under.mean(axis=2, keepdims=True)).astype(np.uint8))
        where, mean_level = "", float(levels.mean())
    canvas.image(box.x, box.y, shown)
    pair, mean = f"{names[0]} and {names[1]}", f"mean {mean_level:.2f}"
    for words in (f"difference between {pair}: {mean} of 255 levels{where}", f"{pair}: {mean} of 255", mean):
        if text_width(words, text) <= size[0] - 2 * box.x - 32:
            break  # the longest that fits, so that the number is not truncated
    label(canvas, *_corner(box, text), words, size=text)
    height = min(max(box.height - 6 * text, 40), 16 * text)
    x, y = size[0] - round(1.7 * text), (size[1] - height) // 2
    canvas.rect(x - 3.3 * text, y - text, 4.7 * text, height + 2 * text, GROUND)
    ramp = heat(np.linspace(HEAT_TOP, 0, height)[:, None].repeat(text, axis=1))
    canvas.image(x, y, ramp)
    for step in range(5):
        value = HEAT_TOP * step / 4
        number = f"{value:.0f}+" if step == 4 else f"{value:.0f}"
        canvas.text(x - 6, y + height * (1 - step / 4) - 0.65 * text, number, text - 1, TEXT, align="right")
    return canvas.pixels


def _corner(box: Box, text: int) -> tuple[int, int]:
    """The place of the label in the upper left corner of an image."""
    margin = round(0.57 * text)
    return box.x + margin, box.y + margin


def label(
    canvas: Canvas,
    x: float,
    y: float,
    text: str,
    align: str = "left",
    color: RGB = TEXT,
    size: int = LABEL_SIZE,
    width: float = math.inf,
) -> None:
    """Draw text on a dark background, legible on any image; truncated if it would be wider than `width`."""
    side, above = round(0.43 * size), round(0.3 * size)
    text = fitted(text, size, width - 2 * side)
    wide = text_width(text, size) + 2 * side
    left = x if align == "left" else x - wide
    canvas.rect(left, y, wide, size + round(0.7 * size), GROUND)
    canvas.text(left + side, y + above, text, size, color)
