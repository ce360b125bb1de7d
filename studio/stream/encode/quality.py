"""Finding the QP of a group, for a target size or quality."""

import math
from collections.abc import Callable, Mapping
from contextlib import closing

import numpy as np

from v3studio.studio.gaussians import Gaussians
from v3studio.studio.stream.decoder import GroupDecoder
from v3studio.studio.stream.manifest import Rendition
from v3studio.studio.stream.settings import QP_MAX

QualityFn = Callable[[int, Gaussians], float]
"""`quality(index, decoded)`: mean squared error between renders of a decoded frame and of the same frame as trained,
colors in 0 to 1; `index` is 0-based within the group."""

QP_BEST = 1  # the search excludes lossless coding (QP 0), which hardware decoders do not support
_FRAMES = 8  # most frames of a group whose error is measured, evenly spaced from its first to its last

_LEAST_FALL, _MOST_FALL = 0.25, 4.0  # of `spare` per QP: two values close to each other may mislead


def highest_qp(spare: Callable[[int], float], start: int) -> int:
    """The highest QP that leaves something to spare, in a few calls; `QP_BEST` - 1 if not even `QP_BEST` is good
    enough.

    `spare` takes a QP from `QP_BEST` to `QP_MAX` and falls by about 1 per QP; at least 0 is good enough. `start` is
    tried first.
    """
    low, high = QP_BEST - 1, QP_MAX + 1
    qp, fall = start, 1.0
    before: tuple[int, float] | None = None
    while high - low > 1:
        value = spare(qp)
        if value >= 0:
            low = qp
        else:
            high = qp
        if before is not None:
            fall = min(max((before[1] - value) / (qp - before[0]), _LEAST_FALL), _MOST_FALL)
        before = (qp, value)
        qp = min(max(qp + math.floor(value / fall), low + 1), high - 1)
    return low


def psnr_of(group: Rendition, files: Mapping[str, bytes], quality: QualityFn) -> float:
    """PSNR in dB of the mean squared error over `_FRAMES` frames of the group, decoded from `files`."""
    last = group.frame_count - 1
    wanted = set(np.linspace(0, last, min(_FRAMES, last + 1)).round().astype(int).tolist())
    with closing(GroupDecoder(group, files, "baking")) as decoder:
        decoded = ((index, decoder.read()) for index in range(last + 1))
        errors = [quality(index, frame.gaussians()) for index, frame in decoded if index in wanted]
    return -10 * math.log10(max(sum(errors) / len(errors), 1e-12))
