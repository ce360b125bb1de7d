"""Encoding of the side file: integers as byte planes, compressed to one raw deflate stream.

Deflate is available on every platform (zlib, DecompressionStream in browsers). Low bytes are mostly noise, where
matches only cost bits: each part is compressed with matches and with Huffman codes only, and the smaller result is
used. Parts end on byte boundaries, so that their concatenation is one deflate stream.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np


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
    """Inverse of `deflate`. Never holds more than `size` bytes.

    Returns:
        (size,) uint8, read-only.

    Raises:
        ValueError: not a deflate stream of exactly `size` bytes.
    """
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

    Raises:
        ValueError: a code needs more than 8 * width bits.
    """
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
