"""Encoding of the side file: integers as byte planes and positions as an octree, compressed to one raw deflate stream.

Deflate is available on every platform (zlib, DecompressionStream in browsers). Low bytes are mostly noise, where
matches only cost bits: each part is compressed with matches and with Huffman codes only, and the smaller result is
used. Parts end on byte boundaries, so that their concatenation is one deflate stream.

The octree has one occupancy byte per filled cell, level by level. Sorted Morton codes are determined by which cells are
filled: bit c of a cell's byte is its child c. Once cells contain a single point, that costs 3 bits per level and point,
which a Huffman code reaches exactly.
"""

import zlib
from collections.abc import Sequence

import numpy as np

_COUNT_BYTES = 4


def deflate(parts: Sequence[bytes]) -> bytes:
    """One raw deflate stream of all parts, each with the strategy that compresses it best."""
    out = bytearray()
    for part in parts:
        best: bytes | None = None
        for strategy in (zlib.Z_DEFAULT_STRATEGY, zlib.Z_HUFFMAN_ONLY):
            encoder = zlib.compressobj(9, zlib.DEFLATED, -15, 9, strategy)
            data = encoder.compress(part) + encoder.flush(zlib.Z_SYNC_FLUSH)
            if best is None or len(data) < len(best):
                best = data
        out += best or b""
    end = zlib.compressobj(9, zlib.DEFLATED, -15)
    return bytes(out) + end.flush()


def inflate(data: bytes, size: int) -> np.ndarray:
    """Inverse of `deflate`, (size,) uint8, never holding more. Raises ValueError: not a stream of that size."""
    decoder = zlib.decompressobj(-15)
    try:
        raw = decoder.decompress(data, size + 1)
        # only the end-of-stream markers remain, which produce no bytes
        if len(raw) == size and not decoder.eof:
            raw += decoder.decompress(decoder.unconsumed_tail, 1)
    except zlib.error as error:
        raise ValueError(f"it cannot be decompressed ({error})") from None
    if len(raw) != size or not decoder.eof or decoder.unused_data:
        raise ValueError(f"it does not decompress to {size} bytes")
    return np.frombuffer(raw, np.uint8)


def split(values: np.ndarray, width: int) -> list[bytes]:
    """Signed integers as `width` byte planes, lowest byte first, of their zigzag codes (0, -1, 1, -2 are 0, 1, 2, 3).
    ValueError if a code needs more than 8 * width bits."""
    wide = values.astype(np.int64).reshape(-1)
    codes = ((wide << 1) ^ (wide >> 63)).astype(np.uint64)
    if codes.size and int(codes.max()) >> (8 * width):
        raise ValueError(f"a value does not fit into {width} bytes")
    return [(codes >> np.uint64(8 * k)).astype(np.uint8).tobytes() for k in range(width)]


class Cursor:
    """Reads the parts of a side file one after the other."""

    def __init__(self, data: np.ndarray) -> None:
        self.rest = data

    def take(self, count: int) -> np.ndarray:
        """The next `count` bytes, (count,) uint8. Raises ValueError if there are fewer."""
        if count > len(self.rest):
            raise ValueError("it ends too early")
        taken, self.rest = self.rest[:count], self.rest[count:]
        return taken

    def integers(self, count: int, width: int) -> np.ndarray:
        """(count,) int64, inverse of `split`."""
        planes = self.take(count * width).reshape(width, count)
        codes = np.zeros(count, dtype=np.int64)
        for k in range(width):
            codes |= planes[k].astype(np.int64) << (8 * k)
        return (codes >> 1) ^ -(codes & 1)


def encode_octree(codes: np.ndarray, bits: int) -> list[bytes]:
    """Occupancy by level, coarsest first, of sorted (N,) codes of 3 * bits bits; then extra points per cell."""
    cells, counts = np.unique(codes, return_counts=True)
    levels: list[bytes] = []
    for _ in range(bits):
        parents, first = np.unique(cells >> np.uint64(3), return_index=True)
        child = np.left_shift(np.uint8(1), (cells & np.uint64(7)).astype(np.uint8))
        levels.append(np.bitwise_or.reduceat(child, first).astype(np.uint8).tobytes())
        cells = parents
    return [*levels[::-1], *split(counts - 1, _COUNT_BYTES)]


def decode_octree(cursor: Cursor, bits: int, splats: int) -> np.ndarray:
    """Inverse of `encode_octree`: (splats,) uint64 codes, sorted; moves the cursor. Raises ValueError."""
    cells = np.zeros(1, dtype=np.uint64)
    for _ in range(bits):
        occupancy = cursor.take(len(cells))
        filled = np.flatnonzero(np.unpackbits(occupancy, bitorder="little").view(bool))  # 8 * parent + child
        if len(filled) > splats or not occupancy.all():
            raise ValueError("the cells of the octree do not match the number of splats")
        cells = (cells[filled >> 3] << np.uint64(3)) | (filled & 7).astype(np.uint64)
    counts = cursor.integers(len(cells), _COUNT_BYTES) + 1
    if counts.min() < 1 or counts.sum() != splats:
        raise ValueError("the points of the octree do not match the number of splats")
    return np.repeat(cells, counts)
