"""Whether a camera's colors differ from the others' by a matrix, a range or a transfer curve: at points that match."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from v3studio.studio.calibration.epipolar import PairMatches
from v3studio.studio.chroma import LUMA_WEIGHTS

LEAST_POINTS = 100  # matches of a camera that can tell
_AROUND = 5  # pixels along the side of a patch whose mean is a point's color
_ALIKE = 60  # gray levels beyond which two points do not show the same
_NEAR, _SURE = (0.75, 1.25), 8.0
"""A camera is off by a difference if it has this share of it, and so many times the uncertainty of that."""


def _luma(standard: str) -> np.ndarray:
    """(3, 3) RGB to luma and chroma."""
    red, _, blue = weights = np.array(LUMA_WEIGHTS[standard])
    return np.stack(
        [weights, (np.array([0, 0, 1]) - weights) / (2 - 2 * blue), (np.array([1, 0, 0]) - weights) / (2 - 2 * red)]
    )


_601, _709 = _luma("bt601"), _luma("bt709")
_DECODE_601: np.ndarray = np.linalg.inv(_601) @ _709
_DECODE_709: np.ndarray = np.linalg.inv(_709) @ _601
DIFFERENCES: Mapping[str, tuple[str, Callable[[np.ndarray], np.ndarray]]] = {
    "matrix": ("is read with the matrix of BT.709, but was coded with that of BT.601", lambda x: x @ _DECODE_601.T),
    "matrix 601": ("is read with the matrix of BT.601, but was coded with that of BT.709", lambda x: x @ _DECODE_709.T),
    "range": ("is read as full range, but is limited", lambda x: (x - 16) * 255 / 219),
    "range full": ("is read as limited range, but is full", lambda x: x * 219 / 255 + 16),
    "transfer": (
        "has a darker transfer curve than the others (linear, or another gamma)",
        lambda x: _power(x, 1 / 2.2),
    ),
    "transfer dark": ("has a brighter transfer curve than the others (a gamma twice)", lambda x: _power(x, 2.2)),
}
"""Differences by kind: words, and what takes colors (N, 3), 0 to 255, to what the others have."""


def _power(colors: np.ndarray, exponent: float) -> np.ndarray:
    return np.asarray(255 * np.clip(colors / 255, 0, 1) ** exponent)


@dataclass(frozen=True)
class ColorDifference:
    """A camera's points, its median distance from the others in levels, and the kind in `DIFFERENCES` that explains it;
    "" if none does."""

    points: int
    levels: float
    kind: str = ""


def color_differences(images: Mapping[str, np.ndarray], pairs: Sequence[PairMatches]) -> dict[str, ColorDifference]:
    """Compare the colors of each image (H, W, 3) uint8 RGB with those of the images that it matches."""
    import cv2

    smooth = {name: cv2.blur(image, (_AROUND, _AROUND)).astype(np.float64) for name, image in images.items()}
    own: dict[str, list[np.ndarray]] = {name: [] for name in images}
    other: dict[str, list[np.ndarray]] = {name: [] for name in images}
    for pair in pairs:
        colors = [_at(smooth[pair.first], pair.first_pixels), _at(smooth[pair.second], pair.second_pixels)]
        for name, (mine, theirs) in ((pair.first, colors), (pair.second, colors[::-1])):
            own[name].append(mine)
            other[name].append(theirs)
    return {name: _difference(np.concatenate(own[name]), np.concatenate(other[name])) for name in images if own[name]}


def _at(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    column, row = np.floor(pixels).astype(int).T
    return np.asarray(image[row.clip(0, image.shape[0] - 1), column.clip(0, image.shape[1] - 1)])


def _difference(own: np.ndarray, other: np.ndarray) -> ColorDifference:
    used = (np.abs(own - other).max(1) < _ALIKE) & (own.max(1) < 250) & (other.max(1) < 250)
    own, other = own[used], other[used]
    levels = float(np.median(np.abs(own - other))) if len(own) else 0.0
    if len(own) < LEAST_POINTS:
        return ColorDifference(len(own), levels)
    best, least = "", np.inf
    for kind, (_, change) in DIFFERENCES.items():
        share, uncertainty, left = _share(own, other, change(own) - own)
        if _NEAR[0] < share < _NEAR[1] and share > _SURE * uncertainty and left < least:
            best, least = kind, left
    return ColorDifference(len(own), levels, best)


def _share(own: np.ndarray, other: np.ndarray, step: np.ndarray) -> tuple[float, float, float]:
    """The share of a difference that a camera has, besides a gain of each channel; its uncertainty; what is left."""
    base = np.zeros((own.size, 4))
    base[:, 0] = step.ravel()
    for channel in range(3):
        base[channel::3, 1 + channel] = own[:, channel]
    wanted, weights = (other - own).ravel(), np.ones(own.size)
    solution, left = np.zeros(4), wanted
    for _ in range(8):
        scaled = base * weights[:, None]
        solution = np.linalg.lstsq(scaled, wanted * weights, rcond=None)[0]
        left = np.abs(wanted - base @ solution)
        weights = 1 / np.sqrt(np.maximum(left, 1.0))
    normal = np.linalg.pinv(base.T @ (base * (weights**2)[:, None]))
    spread = float(np.average(left**2, weights=weights**2))
    return float(solution[0]), float(np.sqrt(max(normal[0, 0], 0) * spread)), float(np.average(left, weights=weights))
