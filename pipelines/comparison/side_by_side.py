"""Pictures of several takes side by side, with their differences from the footage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipelines.reports.evaluation import DIFFERENCE_GAIN
from pipelines.reports.pictures import to_bytes
from studio.comparison import ViewPair, padded_box

_LABEL_HEIGHT, _GAP = 18, 2


def side_by_side(names: Sequence[str], pairs: Sequence[ViewPair], padding: int | None) -> np.ndarray:
    """The footage and each take; below, the take's absolute difference from the footage, amplified.

    Args:
        names: of the takes, for the labels.
        pairs: one view of one frame per take, all of one size or of sizes that differ by a few pixels.
        padding: as in the protocol; None: full frames.

    Returns:
        (H, W, 3) uint8.
    """
    boxes = [(slice(None), slice(None)) if padding is None else padded_box(pair.mask, padding) for pair in pairs]
    cut = [
        (pair.truth[box or ...], pair.drawn[box or ...], _difference(pair)[box or ...])
        for pair, box in zip(pairs, boxes, strict=True)
    ]
    columns = [[_labeled("footage", cut[0][0]), _labeled(f"difference x{DIFFERENCE_GAIN:g}", np.zeros_like(cut[0][0]))]]
    columns += [[_labeled(name, drawn), _labeled("", off)] for name, (_, drawn, off) in zip(names, cut, strict=True)]
    rows = [_joined([column[row] for column in columns], axis=1) for row in (0, 1)]
    return _joined(rows, axis=0)


def _difference(pair: ViewPair) -> np.ndarray:
    return np.clip(np.abs(pair.residual) * DIFFERENCE_GAIN, 0, 1)


def _labeled(text: str, image: np.ndarray) -> np.ndarray:
    """The image below a line of text; letters that OpenCV cannot draw become question marks."""
    import cv2

    strip = np.full((_LABEL_HEIGHT, image.shape[1], 3), 255, np.uint8)
    plain = text.encode("ascii", "replace").decode()
    cv2.putText(strip, plain, (2, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate([strip, to_bytes(image)])


def _joined(images: Sequence[np.ndarray], axis: int) -> np.ndarray:
    """Images in a row (axis 1) or column (axis 0), smaller ones padded with white."""
    other = 1 - axis
    size = max(image.shape[other] for image in images)
    parts = []
    for image in images:
        edges = [[0, 0], [0, 0], [0, 0]]
        edges[other][1] = size - image.shape[other]
        edges[axis][1] = _GAP
        parts.append(np.pad(image, edges, constant_values=255))
    return np.concatenate(parts, axis=axis)
