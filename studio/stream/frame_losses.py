"""Lowers the QP of single frames until encoding costs none of them more than a limit."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

from studio.gaussians import Gaussians
from studio.stream.decode import open_decoder
from studio.stream.manifest_models import GroupEntry

FilmedErrorFn = Callable[[int, Gaussians], tuple[float, float]]
"""`error(index, decoded)`: mean squared errors against the footage, colors in 0 to 1, of the trained frame and of the
same frame as decoded; `index` is 0-based within the group."""

ROUNDS = 5
"""Encodings per group at most."""

_QPS_PER_HALF = 3  # three QPs less halve the squared error of encoding
_FARTHEST = 6  # QPs that one round lowers a frame by at most: the estimate is rough far away


def loss(trained: float, decoded: float) -> float:
    """PSNR in dB that encoding costs, from mean squared errors against the footage; negative for a gain."""
    return 10 * math.log10(max(decoded, 1e-12) / max(trained, 1e-12))


def limited_offsets(
    measure: Callable[[Sequence[int]], Sequence[tuple[float, float]]], frames: int, qp: int, limit: float
) -> tuple[int, ...]:
    """What to add to the QP of each frame, at most 0, so that none loses more than `limit` dB, as far as that is
    possible in `ROUNDS` encodings.

    Args:
        measure: encodes with such offsets and returns, per frame, the errors of `FilmedErrorFn`. The last call is with
            the offsets that are returned.
        frames: number of frames.
        qp: QP of a frame with offset 0; no frame's becomes lower than 1.
        limit: dB, above 0.
    """
    offsets = [0] * frames
    for left in reversed(range(ROUNDS)):
        errors = measure(tuple(offsets))
        changed = [_lowered(offset, qp, *pair, limit) for offset, pair in zip(offsets, errors, strict=True)]
        if left == 0 or changed == offsets:
            break
        offsets = changed
    return tuple(offsets)


def _lowered(offset: int, qp: int, trained: float, decoded: float, limit: float) -> int:
    if loss(trained, decoded) <= limit:
        return offset
    allowed = max(trained, 1e-12) * (10 ** (limit / 10) - 1)
    change = math.ceil(_QPS_PER_HALF * math.log2((decoded - trained) / allowed))
    return max(offset - min(max(change, 1), _FARTHEST), 1 - qp)


def filmed_errors(
    group: GroupEntry, files: Mapping[str, bytes], error: FilmedErrorFn, codec: str
) -> list[tuple[float, float]]:
    """The errors of each frame of a group, decoded from `files`."""
    with ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="decode") as pool:
        decoder = open_decoder(group, files, pool, "baking", codec)
        try:
            return [error(index, decoder.read().gaussians()) for index in range(group.frame_count)]
        finally:
            decoder.close()
