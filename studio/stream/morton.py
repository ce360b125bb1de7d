"""Morton order: splats close in space become neighbors in the image (paper, "Morton Sort")."""

import numpy as np

MORTON_BITS = 21  # bits per axis: coordinates are integers below 2^21, and 3 x 21 bits fit into a uint64

_SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def interleave(cells: np.ndarray) -> np.ndarray:
    """(N,) uint64 Morton codes of (N, 3) integers below 2^21: bits 3i, 3i + 1, 3i + 2 are bits i of x, y, z."""
    codes = np.zeros(len(cells), dtype=np.uint64)
    for axis in range(3):
        bits = cells[:, axis].astype(np.uint64)
        for shift, mask in _SPREAD:
            bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
        codes |= bits << np.uint64(axis)
    return codes


def morton_order(points: np.ndarray) -> np.ndarray:
    """The order of (N, 3) finite positions in the image, (N,) int64: `points[morton_order(points)]` is sorted.
    Coordinates are scaled to 2^21 cells by the longest side of the bounding box, so that cells are cubes. Equal codes
    keep the order of the input, so the result depends on the points only."""
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    if len(points) == 0:
        return np.zeros(0, dtype=np.int64)
    low = points.min(axis=0)
    extent = float((points.max(axis=0) - low).max())
    last = (1 << MORTON_BITS) - 1
    factor = last / extent if extent > 0 else 0.0
    cells = np.clip(np.rint((points - low) * factor), 0, last).astype(np.int64)
    return np.argsort(interleave(cells), kind="stable")


def deinterleave(codes: np.ndarray) -> np.ndarray:
    """Inverse of `interleave`: (N, 3) int64 cells."""
    cells = np.empty((len(codes), 3), dtype=np.int64)
    for axis in range(3):
        bits = (codes >> np.uint64(axis)) & np.uint64(_SPREAD[-1][1])
        for (shift, _), mask in zip(_SPREAD[::-1], (*(mask for _, mask in _SPREAD[-2::-1]), 0x1FFFFF), strict=True):
            bits = (bits | (bits >> np.uint64(shift))) & np.uint64(mask)
        cells[:, axis] = bits
    return cells


def square_scan(side: int, count: int) -> np.ndarray:
    """(count,) int64 row * side + column of splats 0, 1, 2, ... in a square image, along a Morton curve: neighbors in
    the order are close in the image. Pixels are sorted by the number whose bit 2i is bit i of the column and bit 2i + 1
    bit i of the row; if the side is not a power of two, the curve leaves the square in between."""
    axis = np.arange(side, dtype=np.int64)
    spread = np.zeros_like(axis)
    for bit in range(16):
        spread |= ((axis >> bit) & 1) << (2 * bit)
    return np.argsort((spread[None, :] | (spread[:, None] << 1)).reshape(-1), kind="stable")[:count]
