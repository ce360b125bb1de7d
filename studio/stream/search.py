"""Search for the QP that reaches a target size or quality."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.stream.decode import open_decoder
from studio.stream.manifest_models import GroupEntry
from studio.stream.settings import QP_MAX

QualityFn = Callable[[int, Gaussians], float]
"""`quality(index, decoded)`: mean squared error between renders of a decoded frame and of the same frame as trained,
colors in 0 to 1; `index` is 0-based within the group."""

QP_BEST = 1
"""The search excludes lossless coding (QP 0), which hardware decoders do not support."""


def search_qp(measure: Callable[[int], float], target: float, what: str, unit: str, at_most: bool) -> int:
    """The QP that meets a target, by bisection: size and quality both decrease with the QP.

    Args:
        measure: size or quality at a QP.
        target: with `at_most` the largest allowed value, and the lowest QP is found; otherwise the smallest allowed
            value, and the highest QP is found.
        what, unit: for the message.
        at_most: see `target`.

    Raises:
        StudioError: no QP meets the target.
    """
    end = QP_MAX if at_most else QP_BEST
    extreme = measure(end)
    if (extreme > target) if at_most else (extreme < target):
        raise StudioError(
            "bake.target_missed",
            f"{what} has {extreme:.4g} {unit} at QP {end}, which misses the target of {target:.4g}",
            value=extreme,
            fix=f"{'Raise' if at_most else 'Lower'} the target, or train fewer splats.",
            setting="bake.target_kb_per_frame" if at_most else "bake.target_psnr",
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


def measured_psnr(group: GroupEntry, files: Mapping[str, bytes], quality: QualityFn, codec: str) -> float:
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
