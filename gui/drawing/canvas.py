"""Canvas: text, lines and images drawn into a NumPy array, for what has no widget in the toolkit."""

from __future__ import annotations

import importlib.util
import re
from bisect import bisect_right
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from v3studio.gui.drawing.icons import FONT, ICON_SIZE, icon
from v3studio.gui.drawing.palette import BORDER, GROUND, RAISED, RGB, TEXT

ROUND = 0.25  # radius of the corners of buttons in font sizes, as the toolkit draws its own


@lru_cache(maxsize=16)
def _font(size: int) -> Any:
    """The window's font (Roboto, which Open3D ships), else Pillow's."""
    package = importlib.util.find_spec("open3d")  # finds the folder, imports nothing
    for folder in (package.submodule_search_locations or []) if package else []:
        path = Path(folder) / "resources" / "Roboto-Medium.ttf"
        if path.is_file():
            return ImageFont.truetype(str(path), size)
    return ImageFont.load_default(size)


KEPT_TEXTS = 1024
"""Drawn lines of text that are kept: a few times as many as a window shows. Others come as long as numbers change."""


@lru_cache(maxsize=KEPT_TEXTS)
def _glyphs(text: str, size: int) -> np.ndarray:
    """(h, w) uint8 coverage of a line of text, 255 = whole; the height depends only on the font size."""
    image = Image.new("L", (text_width(text, size), glyph_height(size)))
    ImageDraw.Draw(image).text((0, 0), text, fill=255, font=_font(size))
    return np.asarray(image)


@lru_cache(maxsize=64)
def _icon(key: str, side: int) -> np.ndarray:
    """(side, side) uint8 coverage of an icon."""
    image = Image.new("L", (side, side))
    size = max(round(side / ICON_SIZE), 1)
    font = ImageFont.truetype(str(FONT), size, layout_engine=ImageFont.Layout.BASIC)  # some codes are combining marks
    ImageDraw.Draw(image).text((side / 2, side / 2), icon(key), fill=255, font=font, anchor="mm")
    return np.asarray(image)


_BEFORE_UNIT = re.compile(r"(?<=\d) (?=(dB|px|[KMG]B|kbit/s|Mbit/s|fps|s|min|h|of \d+|levels)\b)")
"""The space between a number and its unit, where no line ends."""


@lru_cache(maxsize=4096)
def text_width(text: str, size: int) -> int:
    """Width of a line of text in pixels."""
    return max(int(_font(size).getlength(text) + 0.999), 1) if text else 0


def glyph_height(size: int) -> int:
    """Height of a line of text from the top of the highest glyph to the bottom of the lowest, pixels."""
    return int(sum(_font(size).getmetrics()))


def fitted(text: str, size: int, width: float) -> str:
    """The text, truncated with an ellipsis if it is wider than `width` pixels."""
    if text_width(text, size) <= width:
        return text
    lengths = range(1, len(text) + 1)
    fits = bisect_right(lengths, width, key=lambda length: text_width(text[:length].rstrip() + "…", size))
    return text[:fits].rstrip() + "…" if fits else ""


def wrapped(text: str, size: int, width: float) -> list[str]:
    """Lines no wider than `width` pixels; a word or a number with its unit is broken only if it alone is wider."""
    lines: list[str] = []
    for paragraph in _BEFORE_UNIT.sub("\u00a0", text).splitlines() or [""]:
        line = ""
        for word in paragraph.split(" "):
            longer = f"{line} {word}" if line else word
            if text_width(longer, size) <= width:
                line = longer
                continue
            if line:
                lines.append(line)
            while text_width(word, size) > width and len(word) > 1:
                count = max(len(fitted(word, size, width)) - 1, 1)
                lines.append(word[:count])
                word = word[count:]
            line = word
        lines.append(line)
    return lines


def shortened(text: str, size: int, width: float, most: int, rest: str) -> list[str]:
    """The lines of `wrapped`, at most `most`; if there are more, the last one is `rest`, which says where they are."""
    lines = wrapped(text, size, width)
    return lines if len(lines) <= most else [*lines[: most - 1], rest]


class Canvas:
    """An image to draw into, (height, width, 3) uint8 RGB. Coordinates are pixels from the upper left corner."""

    def __init__(self, width: float, height: float, color: RGB = GROUND) -> None:
        self.pixels = np.empty((max(int(height), 1), max(int(width), 1), 3), np.uint8)
        self.pixels[:] = color

    @classmethod
    def of(cls, pixels: np.ndarray) -> Canvas:
        """Draw into an image of one's own."""
        canvas = cls(1, 1)
        canvas.pixels = pixels
        return canvas

    @property
    def width(self) -> int:
        """Pixels."""
        return int(self.pixels.shape[1])

    @property
    def height(self) -> int:
        """Pixels."""
        return int(self.pixels.shape[0])

    def rect(self, x: float, y: float, width: float, height: float, color: RGB) -> None:
        left, top = max(round(x), 0), max(round(y), 0)
        self.pixels[top : max(round(y + height), top), left : max(round(x + width), left)] = color

    def frame(self, x: float, y: float, width: float, height: float, color: RGB) -> None:
        """Draw a rectangle's outline, one pixel wide."""
        self.rect(x, y, width, 1, color)
        self.rect(x, y + height - 1, width, 1, color)
        self.rect(x, y, 1, height, color)
        self.rect(x + width - 1, y, 1, height, color)

    def rounded(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        radius: float,
        color: RGB | None,
        border: RGB | None = None,
        thick: float = 1.0,
    ) -> None:
        """Draw an antialiased rectangle with round corners, its outline inside of it; None: no fill, no outline."""
        left, top, wide, high = round(x), round(y), max(round(width), 1), max(round(height), 1)
        rows, columns = np.mgrid[0:high, 0:wide] + 0.5
        across = np.abs(columns - wide / 2) - (wide / 2 - radius)
        down = np.abs(rows - high / 2) - (high / 2 - radius)
        # distance from the edge, negative inside
        away = np.hypot(np.maximum(across, 0), np.maximum(down, 0)) + np.minimum(np.maximum(across, down), 0) - radius
        whole, inner = (255 * np.clip(0.5 - away - inset, 0, 1) for inset in (0.0, thick))
        if color is not None:
            self._blend(whole, left, top, color)
        if border is not None:
            self._blend(whole - inner, left, top, border)

    def button(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        words: str,
        size: int,
        ground: RGB = RAISED,
        color: RGB = TEXT,
        border: RGB = BORDER,
    ) -> None:
        """Draw a button as the toolkit draws its own, with its words in the middle, shortened if there is no room."""
        self.rounded(x, y, width, height, ROUND * size, ground, border)
        top = y + (height - glyph_height(size)) / 2
        self.text(x + width / 2, top, words, size, color, "middle", width=width - 0.5 * size)

    def dot(self, x: float, y: float, radius: float, color: RGB, filled: bool = True) -> None:
        """Draw an antialiased disc or ring."""
        place, size = (round(x * 16), round(y * 16)), round(radius * 16)
        cv2.circle(self.pixels, place, size, color, -1 if filled else 2, cv2.LINE_AA, 4)

    def diamond(self, x: float, y: float, half: float, color: RGB) -> None:
        """Draw a filled square that stands on a corner; `half` is the distance from its middle to a corner."""
        corners = np.array([(x, y - half), (x + half, y), (x, y + half), (x - half, y)])
        cv2.fillConvexPoly(self.pixels, np.round(corners).astype(np.int32), color)

    def line(self, points: Sequence[tuple[float, float]] | np.ndarray, color: RGB, thickness: int = 1) -> None:
        """Draw an antialiased line through (N, 2) points."""
        fixed = np.round(np.clip(np.asarray(points, np.float64), -1e5, 1e5) * 16).astype(np.int32).reshape(-1, 1, 2)
        if len(fixed) > 1:
            cv2.polylines(self.pixels, [fixed], False, color, thickness, cv2.LINE_AA, 4)

    def text(
        self,
        x: float,
        y: float,
        text: str,
        size: int,
        color: RGB = TEXT,
        align: str = "left",
        width: float | None = None,
    ) -> int:
        """Draw a line of text with its upper left corner (align "left"), upper right ("right") or upper middle
        ("middle") at (x, y), truncated if it is wider than `width`. Returns its width in pixels."""
        if width is not None:
            text = fitted(text, size, width)
        if not text:
            return 0
        cover = _glyphs(text, size)
        left = round(x) - {"left": 0, "right": cover.shape[1], "middle": cover.shape[1] // 2}[align]
        self._blend(cover, left, round(y), color)
        return int(cover.shape[1])

    def lines(
        self, x: float, y: float, lines: Sequence[str], size: int, color: RGB = TEXT, align: str = "left"
    ) -> float:
        """Draw lines of text below each other, see `text`; return where the next one would be."""
        for line in lines:
            self.text(x, y, line, size, color, align)
            y += line_height(size)
        return y

    def icon(self, x: float, y: float, key: str, side: float, color: RGB = TEXT) -> None:
        """Draw an icon, by its key in `ICONS`, in a square whose upper left corner is at (x, y)."""
        self._blend(_icon(key, max(round(side), 1)), round(x), round(y), color)

    def image(self, x: float, y: float, pixels: np.ndarray) -> None:
        """Draw an (h, w, 3) uint8 image, clipped to the canvas."""
        there, part = self._clipped(pixels, round(x), round(y))
        there[:] = part

    def fit_image(
        self, x: float, y: float, width: float, height: float, pixels: np.ndarray
    ) -> tuple[int, int, int, int]:
        """Fit an image into a rectangle, keeping its aspect ratio; return its rectangle (x, y, width, height)."""
        scale = min(width / pixels.shape[1], height / pixels.shape[0])
        size = max(int(pixels.shape[1] * scale), 1), max(int(pixels.shape[0] * scale), 1)
        small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        left, top = int(x + (width - size[0]) / 2), int(y + (height - size[1]) / 2)
        self.image(left, top, small)
        return left, top, *size

    def _clipped(self, image: np.ndarray, left: int, top: int) -> tuple[np.ndarray, np.ndarray]:
        """The part of the canvas that an image covers whose upper left corner is there, and that part of the image."""
        there = self.pixels[max(top, 0) : max(top + image.shape[0], 0), max(left, 0) : max(left + image.shape[1], 0)]
        part = image[max(-top, 0) :, max(-left, 0) :]
        return there, part[: there.shape[0], : there.shape[1]]

    def _blend(self, cover: np.ndarray, left: int, top: int, color: RGB) -> None:
        below, part = self._clipped(cover, left, top)
        below[:] = np.round(below + (np.array(color, np.float32) - below) * (part[..., None] / np.float32(255)))


def line_height(size: int) -> int:
    """Line spacing of text in pixels."""
    return round(size * 1.45)
