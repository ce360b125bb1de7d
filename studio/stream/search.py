"""Finding the QP that reaches a size or a quality."""

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
"""`quality(index, decoded)`: mean squared error, colors in 0 to 1, of the decoded frame `index` (0-based within its
group) as drawn, against the same frame as trained."""

QP_BEST = 1
"""The search stays above lossless coding, which hardware decoders do not take."""


def search_qp(measure: Callable[[int], float], target: float, what: str, unit: str, at_most: bool) -> int:
    """The QP that meets a target, by bisection: both size and quality fall as the QP rises.

    Args:
        measure: what a QP gives.
        target: largest value allowed (`at_most`: then the lowest such QP is found) or smallest (the highest QP).
        what, unit: for the message.
        at_most: which of the two.

    Raises:
        StudioError: no QP meets it.
    """
    end = QP_MAX if at_most else QP_BEST
    extreme = measure(end)
    if (extreme > target) if at_most else (extreme < target):
        raise StudioError(
            f"Baking: {what} reaches {extreme:.4g} {unit} at QP {end}, which misses the target of {target:.4g}; "
            + ("allow more" if at_most else "ask for less")
            + " or change the splats."
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
