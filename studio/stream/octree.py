"""Quantized positions as an octree: one occupancy byte per filled cell, level by level.

Sorted Morton codes are determined by which cells are filled: bit c of a cell's byte is its child c. Once cells contain
a single point, that costs 3 bits per level and point, which a Huffman code reaches exactly.
"""

from __future__ import annotations

import numpy as np

from studio.stream.sidefile import Cursor, split

COUNT_BYTES = 4


def encode_octree(codes: np.ndarray, bits: int) -> list[bytes]:
    """Occupancy of the levels, coarsest first, then the number of further points in each filled cell.

    Args:
        codes: (N,) uint64 Morton codes of 3 * bits bits, sorted.
        bits: levels.

    Returns:
        Parts for `sidefile.deflate`: `bits` levels, then four byte planes of (points - 1) per filled cell.
    """
    cells, counts = np.unique(codes, return_counts=True)
    levels: list[bytes] = []
    for _ in range(bits):
        parents, first = np.unique(cells >> np.uint64(3), return_index=True)
        child = np.left_shift(np.uint8(1), (cells & np.uint64(7)).astype(np.uint8))
        levels.append(np.bitwise_or.reduceat(child, first).astype(np.uint8).tobytes())
        cells = parents
    return [*levels[::-1], *split(counts - 1, COUNT_BYTES)]


def decode_octree(cursor: Cursor, bits: int, splats: int) -> np.ndarray:
    """Inverse of `encode_octree`.

    Args:
        cursor: at the first byte of the octree; afterwards behind its last.
        bits, splats: what was encoded.

    Returns:
        (splats,) uint64 Morton codes, sorted.

    Raises:
        ValueError: the bytes are not an octree of that many points.
    """
    cells = np.zeros(1, dtype=np.uint64)
    for _ in range(bits):
        occupancy = cursor.take(len(cells))
        filled = np.flatnonzero(np.unpackbits(occupancy, bitorder="little").view(bool))  # 8 * parent + child
        if len(filled) > splats or not occupancy.all():
            raise ValueError("the cells of the octree do not match the number of splats")
        cells = (cells[filled >> 3] << np.uint64(3)) | (filled & 7).astype(np.uint64)
    counts = cursor.integers(len(cells), COUNT_BYTES) + 1
    if counts.min() < 1 or counts.sum() != splats:
        raise ValueError("the points of the octree do not match the number of splats")
    return np.repeat(cells, counts)
