"""Text, rectangles and images on a canvas: which pixels change."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from gui.drawing.canvas import Canvas, fitted, line_height, text_width, wrapped

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


def test_a_rounded_rectangle_lacks_its_corners_and_has_its_outline_inside() -> None:
    canvas = Canvas(40, 30, BLACK)
    canvas.rounded(5, 4, 30, 20, 6, RED, WHITE, 2)
    rows, columns = np.nonzero(drawn(canvas))
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (4, 23, 5, 34)
    assert not drawn(canvas)[[4, 4, 23, 23], [5, 34, 5, 34]].any(), "the corners"
    assert (canvas.pixels[14, [5, 6, 33, 34]] == WHITE).all()
    assert (canvas.pixels[14, 7:33] == RED).all()
    ring = Canvas(40, 30, BLACK)
    ring.rounded(5, 4, 30, 20, 6, None, WHITE, 2)
    assert not drawn(ring)[6:22, 12:28].any()
    assert np.array_equal(ring.pixels[14, :7], canvas.pixels[14, :7])


@pytest.mark.parametrize("words", ["New point (N)", WORDS])
def test_the_words_of_a_button_are_in_its_middle(words: str) -> None:
    canvas = Canvas(220, 60, BLACK)
    canvas.button(10, 10, 200, 40, words, 14, ground=BLACK, border=BLACK)
    rows, columns = np.nonzero(drawn(canvas))
    assert 12 < columns.min() < columns.max() < 208
    assert abs((columns.min() + columns.max()) / 2 - 110) < 3
    assert abs((rows.min() + rows.max()) / 2 - 30) < 3


def test_a_frame_is_one_pixel_wide() -> None:
    canvas = Canvas(20, 12, BLACK)
    canvas.frame(4, 3, 10, 6, RED)
    inside = np.zeros((12, 20), bool)
    inside[3:9, 4:14] = True
    inside[4:8, 5:13] = False
    assert np.array_equal(drawn(canvas), inside)


@pytest.mark.parametrize(("align", "left"), [("left", 0.0), ("right", 1.0), ("middle", 0.5)])
def test_where_text_stands(align: str, left: float) -> None:
    canvas = Canvas(300, 40, BLACK)
    width = canvas.text(150, 8, "MHM", 16, WHITE, align=align)
    assert width == text_width("MHM", 16)
    columns = np.flatnonzero(drawn(canvas).any(axis=0))
    rows = np.flatnonzero(drawn(canvas).any(axis=1))
    assert columns[0] == pytest.approx(150 - left * width, abs=3)
    assert columns[-1] == pytest.approx(150 + (1 - left) * width, abs=3)
    assert 8 <= rows[0] < rows[-1] < 8 + line_height(16)
    assert canvas.text(0, 0, "", 16) == 0


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


def test_texts_that_were_drawn_once_take_little_memory() -> None:
    """Numbers change all the time: an hour of them must not stay."""
    import tracemalloc

    canvas = Canvas(900, 40, BLACK)
    canvas.text(0, 0, "first", 16)
    tracemalloc.start()
    try:
        for number in range(3000):
            canvas.text(0, 0, f"frame {number}: {number / 7:.3f} dB, drawn in {number / 3:.2f} ms, {number} splats", 16)
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 16 * 2**20, f"{kept / 2**20:.0f} MiB"
