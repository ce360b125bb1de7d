"""Text, rectangles and images on a canvas: which pixels change."""

import itertools

import numpy as np
import pytest

from gui.drawing.canvas import Canvas, fitted, text_width, wrapped

BLACK, RED, WHITE = (0, 0, 0), (255, 0, 0), (255, 255, 255)
WORDS = "Twelve cameras look at the performer from all sides"


def drawn(canvas: Canvas) -> np.ndarray:
    """(H, W) bool: pixels that are not black."""
    return canvas.pixels.any(axis=2)


@pytest.mark.parametrize("size", [12, 20])
def test_text_is_cut_as_late_as_possible(size: int) -> None:
    whole = text_width(WORDS, size)
    assert fitted(WORDS, size, whole) == WORDS
    for width in (whole - 1, whole / 2, 5 * size):
        short = fitted(WORDS, size, width)
        kept = short.removesuffix("…")
        assert short != kept
        assert WORDS.startswith(kept)
        assert text_width(short, size) <= width
        assert text_width(WORDS[: len(kept) + 2].rstrip() + "…", size) > width
    assert fitted(WORDS, size, 1) == ""


def test_lines_are_broken_between_words() -> None:
    lines = wrapped(WORDS, 14, 120)
    assert " ".join(lines) == WORDS
    assert len(lines) > 2
    assert all(text_width(line, 14) <= 120 for line in lines)
    for line, after in itertools.pairwise(lines):
        assert text_width(f"{line} {after.split()[0]}", 14) > 120, "the first word of the next line had room"
    long = wrapped("a " + "w" * 60 + " b", 14, 100)
    assert "".join(long).replace(" ", "") == "a" + "w" * 60 + "b"
    assert all(text_width(line, 14) <= 100 for line in long)
    assert wrapped("one\ntwo", 14, 500) == ["one", "two"]


@pytest.mark.parametrize("place", [(3, 2, 4, 5), (-2, -3, 6, 6), (15, 8, 20, 20), (2, 2, 0, 4), (-9, -9, 3, 3)])
def test_rectangles_are_clipped(place: tuple[int, int, int, int]) -> None:
    x, y, width, height = place
    canvas = Canvas(20, 10, BLACK)
    canvas.rect(x, y, width, height, RED)
    rows, columns = np.mgrid[0:10, 0:20]
    inside = (columns >= x) & (columns < x + width) & (rows >= y) & (rows < y + height)
    assert np.array_equal(drawn(canvas), inside)
    assert (canvas.pixels[inside] == RED).all()


def test_images_are_clipped_and_fitted() -> None:
    picture = np.arange(5 * 8 * 3, dtype=np.uint8).reshape(5, 8, 3) + 1
    for x, y in ((3, 2), (-3, -1), (16, 8), (-8, 0)):
        canvas = Canvas(20, 10, BLACK)
        canvas.image(x, y, picture)
        expected = np.zeros((30, 40, 3), np.uint8)
        expected[10 + y : 15 + y, 10 + x : 18 + x] = picture
        assert np.array_equal(canvas.pixels, expected[10:20, 10:30])
    canvas = Canvas(100, 60, BLACK)
    assert canvas.fit_image(10, 5, 80, 50, np.full((10, 40, 3), 200, np.uint8)) == (10, 20, 80, 20)
    assert np.array_equal(np.argwhere(drawn(canvas))[[0, -1]], [[20, 10], [39, 89]])
