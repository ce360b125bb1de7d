"""The meaning of the values of mask files: soft masks, or labels of people and parts.

Programs write the same mask as 0 and 255, 0 and 1, 0 and 65535, as a float from 0 to 1, as the alpha channel, as the
number of a palette's color, or as the number of a person or a part of the body. Whether small numbers are labels or the
edge of a soft mask cannot be seen in one image, so `MaskValues` is found from several images of a camera.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from v3studio.studio.capture.images import read_values
from v3studio.studio.masks.filters import largest_channel

LOSSY = frozenset({".jpg", ".jpeg", ".webp"})
"""Extensions of images whose values are not exact, so that they cannot be labels."""

INVERTED = (0,)  # the chosen labels with which the background of masks is the foreground
_MOST_LABELS = 24  # more than people in a capture or parts of a body; soft masks have more values
_FLAT = 0.3  # share of the pixels between black and white whose neighbors are the same, if they are labels
_SCALES = {True: (255.0, 65535.0), False: (1.0, 255.0, 65535.0)}
"""Values of full scale, by whether all values are integers."""


@dataclass(frozen=True)
class MaskValues:
    """The meaning of the values of a camera's masks."""

    labels: tuple[int, ...] = ()  # the numbers that were found, without 0, if they are labels; empty for soft masks
    full: float = 255.0  # the value of a soft mask that is entirely foreground
    highest: float = 0.0  # the highest value found; 0 if all masks are empty
    is_soft: bool = False  # whether there are other values than 0 and `full`
    border: float = 0.0  # the share of the images' borders that is foreground
    around: float = 0.0  # the commonest value of the borders
    lowest: float = 0.0  # the lowest value found; above 0 if no mask has background

    def mask(self, values: np.ndarray, chosen: Sequence[int] = ()) -> np.ndarray:
        """(H, W) uint8, 255 = foreground, of values (H, W) as from `read_mask_values`. `chosen`: the labels that are
        foreground; empty: all but 0. Of soft masks, only `INVERTED` counts."""
        if values.dtype == np.uint8:  # many pixels of few values
            return self._mask(np.arange(256), chosen)[values]
        return self._mask(values, chosen)

    def _mask(self, values: np.ndarray, chosen: Sequence[int]) -> np.ndarray:
        if self.labels:
            is_inside = np.isin(values, chosen) if chosen else values != 0
            return np.where(is_inside, 255, 0).astype(np.uint8)
        scaled = np.clip(np.rint(values.astype(np.float64) * (255.0 / self.full)), 0, 255).astype(np.uint8)
        return 255 - scaled if tuple(chosen) == INVERTED else scaled

    def __str__(self) -> str:
        if self.labels:
            numbers = ", ".join(map(str, self.labels[:6])) + (", ..." if len(self.labels) > 6 else "")
            return f"labels {numbers}" if len(self.labels) > 1 else f"0 and {numbers}"
        return f"soft values from 0 to {self.full:g}" if self.is_soft else f"0 and {self.full:g}"


def read_mask_values(path: Path) -> np.ndarray:
    """The values of a mask image, (H, W): `mask_channel` of its pixels or, of an image with a palette, the indices. If
    the palette is grays with black and white, the image is gray, and its colors count. Raises StudioError as
    `read_values`."""
    values, palette = read_values(path)
    if palette is not None:
        used = palette[np.unique(values)]
        return palette[values, 0] if (used == used[:, :1]).all() and {0, 255} <= set(used[:, 0].tolist()) else values
    return mask_channel(values)


def mask_channel(values: np.ndarray) -> np.ndarray:
    """The mask, (H, W), in an image, (H, W) or (H, W, 3 or 4; RGB or RGBA): alpha if any pixel is transparent, else the
    largest channel."""
    if values.ndim == 2:
        return values
    if values.shape[2] == 4:
        alpha = values[:, :, 3]
        if (alpha < (1 if alpha.dtype.kind == "f" else np.iinfo(alpha.dtype).max)).any():
            return alpha
    return largest_channel(values)


def values_in(images: Sequence[np.ndarray], exact: bool, chosen: Sequence[int] = ()) -> MaskValues:
    """The meaning of the values of masks, (H, W) each, as from `read_mask_values`; `chosen`: as in `MaskValues.mask`.

    Few different numbers are labels if those between black and white fill areas. Those of smooth edges do not, and if
    the masks are not `exact`, but were stored with loss, there are no labels.
    """
    numbers: set[float] = set().union(*(np.unique(values).tolist() for values in images))
    integral = all(float(number).is_integer() for number in numbers)
    highest = max(numbers, default=0)
    full = next((scale for scale in _SCALES[integral] if highest <= 1.001 * scale), _SCALES[integral][-1])
    seen = numbers - {0}
    labels: tuple[int, ...] = ()
    if exact and integral and len(seen) <= _MOST_LABELS and _has_areas(images, full):
        labels = tuple(sorted(int(number) for number in seen))
    meaning = MaskValues(labels, full, float(highest), bool(seen - {full}))
    around = np.concatenate([part for edge in images for part in (edge[0], edge[-1], edge[:, 0], edge[:, -1])])
    is_inside = meaning.mask(around[None], chosen) > 127
    edge_values, counts = np.unique(around, return_counts=True)
    return replace(
        meaning,
        border=float(is_inside.mean()),
        around=float(edge_values[counts.argmax()]),
        lowest=float(min(numbers, default=0)),
    )


def _has_areas(images: Sequence[np.ndarray], full: float) -> bool:
    between = flat = 0
    for values in images:
        inside = ((values != 0) & (values != full))[:-1, :-1]
        same = (values[:-1, :-1] == values[1:, :-1]) & (values[:-1, :-1] == values[:-1, 1:])
        between += int(inside.sum())
        flat += int((inside & same).sum())
    return flat > _FLAT * between
