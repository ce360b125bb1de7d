"""Finding QPs: of a group, for a target size or quality; of single frames, so that none loses more than a limit."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.stream.codecs import QP_MAX
from studio.stream.decoders import open_decoder
from studio.stream.manifest import Rendition

QualityFn = Callable[[int, Gaussians], float]
"""`quality(index, decoded)`: mean squared error between renders of a decoded frame and of the same frame as trained,
colors in 0 to 1; `index` is 0-based within the group."""

FilmedErrorFn = Callable[[int, Gaussians], tuple[float, float]]
"""`error(index, decoded)`: mean squared errors against the footage, colors in 0 to 1, of the trained frame and of the
same frame as decoded; `index` is 0-based within the group."""

ROUNDS = 5
"""Encodings per group at most."""

_QPS_PER_HALF = 3  # three QPs less halve the squared error of encoding
_FARTHEST = 6  # QPs that one round lowers a frame by at most: the estimate is rough far away

QP_BEST = 1
"""The search excludes lossless coding (QP 0), which hardware decoders do not support."""


def search_qp(measure: Callable[[int], float], target: float, what: str, unit: str, at_most: bool) -> int:
    """The QP that meets a target, by bisection: size and quality both decrease with the QP.

    Args:
        measure: size or quality at a QP.
        target: with `at_most` the largest allowed value, and the lowest QP is found; otherwise the smallest allowed
            value, and the highest QP is found.
        at_most: see `target`.
    """
    end = QP_MAX if at_most else QP_BEST
    extreme = measure(end)
    if (extreme > target) if at_most else (extreme < target):
        raise StudioError(
            "bake.target_missed",
            f"{what} has {extreme:.4g} {unit} at QP {end}, which misses the target of {target:.4g}",
            value=extreme,
            fix=f"{'Raise' if at_most else 'Lower'} the target, or train fewer splats.",
            setting="bake.quality",
            qp=end,
            expected=target,
        )
    good, bad = end, (QP_BEST if at_most else QP_MAX)
    if (measure(bad) <= target) if at_most else (measure(bad) >= target):
        return bad
    while abs(good - bad) > 1:
        middle = (good + bad) // 2
        value = measure(middle)
        if (value <= target) if at_most else (value >= target):
            good = middle
        else:
            bad = middle
    return good


def psnr_of(group: Rendition, files: Mapping[str, bytes], quality: QualityFn, codec: str) -> float:
    """PSNR in dB over the group's first, middle and last frame, decoded from `files`."""
    last = group.frame_count - 1
    wanted = sorted({0, last // 2, last})
    errors = []
    with ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="decode") as pool:
        decoder = open_decoder(group, files, pool, "baking", codec)
        try:
            for index in range(last + 1):
                decoded = decoder.read()
                if index in wanted:
                    errors.append(quality(index, decoded.gaussians()))
        finally:
            decoder.close()
    return -10 * math.log10(max(sum(errors) / len(errors), 1e-12))


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
    group: Rendition, files: Mapping[str, bytes], error: FilmedErrorFn, codec: str
) -> list[tuple[float, float]]:
    """The errors of each frame of a group, decoded from `files`."""
    with ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="decode") as pool:
        decoder = open_decoder(group, files, pool, "baking", codec)
        try:
            return [error(index, decoder.read().gaussians()) for index in range(group.frame_count)]
        finally:
            decoder.close()
