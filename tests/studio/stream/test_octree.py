"""Octree, side file encoding and pixel scan against straightforward definitions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.studio.formats.test_damage import at_most
from v3studio.studio.stream.morton import deinterleave, interleave, square_scan
from v3studio.studio.stream.sidefile import Cursor, decode_octree, deflate, encode_octree, inflate

CELLS = st.lists(st.tuples(*[st.integers(0, 255)] * 3), min_size=1, max_size=60)


@settings(max_examples=60, deadline=None)
@given(cells=CELLS, copies=st.integers(1, 300))
def test_octree_gives_the_codes_back(cells: list[tuple[int, int, int]], copies: int) -> None:
    codes = np.sort(np.repeat(interleave(np.array(cells)), copies))
    data = b"".join(encode_octree(codes, 8))
    cursor = Cursor(np.frombuffer(data, np.uint8))
    assert np.array_equal(decode_octree(cursor, 8, len(codes)), codes)
    assert len(cursor.rest) == 0


def test_octree_as_described() -> None:
    """docs/STREAM.md by hand: cells (0, 0, 0), (3, 0, 1) and, with two splats, (1, 2, 3) of 4 x 4 x 4."""
    root = 0b0100_0011  # children 0; 1 (x 2..3); 6 (y 2..3, z 2..3)
    leaves = [0b0000_0001, 0b0010_0000, 0b0010_0000]  # (0, 0, 0); (1, 0, 1) in its half; (1, 0, 1) in its half
    counts = bytes([0, 0, 2]) + bytes(9)  # zigzag of how many more splats, four byte planes
    codes = np.array([0, 8 + 5, 6 * 8 + 5, 6 * 8 + 5], np.uint64)
    assert deinterleave(codes).tolist() == [[0, 0, 0], [3, 0, 1], [1, 2, 3], [1, 2, 3]]
    data = bytes([root, *leaves]) + counts
    assert b"".join(encode_octree(codes, 2)) == data
    assert decode_octree(Cursor(np.frombuffer(data, np.uint8)), 2, 4).tolist() == codes.tolist()


@settings(max_examples=100, deadline=None)
@given(data=st.binary(max_size=80), bits=st.integers(1, 16), splats=st.integers(1, 50))
def test_any_bytes_as_an_octree_end(data: bytes, bits: int, splats: int) -> None:
    try:
        codes = decode_octree(Cursor(np.frombuffer(data, np.uint8)), bits, splats)
    except ValueError:
        return
    assert len(codes) == splats
    assert (np.diff(codes.astype(np.int64)) >= 0).all()


def test_inflate_stops_at_the_promised_size() -> None:
    bomb = deflate([bytes(2_000_000)])
    with at_most(100_000), pytest.raises(ValueError, match="1000 bytes"):
        inflate(bomb, 1000)
    for size in (10, 1_999_999, 2_000_001):
        with pytest.raises(ValueError, match="decompress to"):
            inflate(bomb, size)
    with pytest.raises(ValueError, match="decompress"):
        inflate(deflate([b"abc"])[:-3], 3)
    with pytest.raises(ValueError, match="decompress"):
        inflate(b"\xff" * 20, 3)


@pytest.mark.parametrize("side", [16, 48])
def test_square_scan_is_a_z_curve_over_all_pixels(side: int) -> None:
    scan = square_scan(side, side * side)
    assert np.array_equal(np.sort(scan), np.arange(side * side))
    rows, columns = np.divmod(scan, side)
    assert [(int(r), int(c)) for r, c in zip(rows[:8], columns[:8], strict=True)] == [
        (0, 0), (0, 1), (1, 0), (1, 1), (0, 2), (0, 3), (1, 2), (1, 3)
    ]  # fmt: skip
    block = (rows // 16) * side + columns // 16  # a codec's block holds splats that follow each other
    assert (np.diff(block) != 0).sum() == (side // 16) ** 2 - 1
