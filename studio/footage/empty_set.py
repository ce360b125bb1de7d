"""The set behind the performer in each camera: the clean plate, or what the footage shows outside of the masks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from v3studio.studio.masks.agreement.empty_set import cover, median_outside
from v3studio.studio.masks.clean_plate import Background
from v3studio.studio.masks.filters import reduced
from v3studio.studio.masks.mask_source import evenly_spaced
from v3studio.studio.masks.median_background import background_cache

if TYPE_CHECKING:
    from v3studio.studio.footage.footage import Footage

_FRAMES = 15  # most that an estimate reads
_FEWEST = 3  # fewer frames do not tell the set from the performer
_MASK_SIDE = 640  # longest side of masks when their surroundings are covered
_HOLE_SIDE = 160  # longest side of the image from which holes are filled


class EmptySets:
    """The set of each camera, loaded or estimated once per camera, as far as that fits into memory."""

    def __init__(self, footage: Footage) -> None:
        self._footage = footage
        self._sets = background_cache()

    def plate(self, camera: str) -> np.ndarray | None:
        """The set, as `FootageView.plate`, with what is near filled in where it is not reliable; None if there are
        neither plates nor enough frames. Raises StudioError: an image or a mask cannot be read."""
        plate = self._sets.get_or_make(camera, lambda name: Background(self._plate(name))).plate
        return plate if plate.size else None

    def _plate(self, camera: str) -> np.ndarray:
        footage = self._footage
        plate = footage.plate(camera)
        if plate is None and len(footage.frames) >= _FEWEST:
            views = [footage.view(camera, frame) for frame in evenly_spaced(footage.frames, _FRAMES)]
            plate = outside([view.image for view in views], [view.mask for view in views])
        if plate is None or (plate.shape[2] == 4 and not plate[..., 3].any()):
            return np.zeros((0, 0, 3), np.uint8)
        return filled(plate)


def outside(images: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> np.ndarray:
    """The median of images (H, W, 3) uint8 outside of their masks (H, W) uint8 and of what these may lack: (H, W, 4)
    uint8, with 0 instead of 255 in the last channel where no image shows the set."""
    covers = [cover(reduced(mask, _MASK_SIDE) > 0) for mask in masks]
    # also where the performer is before and after: what single masks lack is no set
    hidden = [np.logical_or.reduce(covers[max(0, index - 1) : index + 2]) for index in range(len(covers))]
    plate, shown = median_outside(images, hidden)
    return np.dstack([plate, np.where(shown > 0, np.uint8(255), np.uint8(0))])


def filled(plate: np.ndarray) -> np.ndarray:
    """A plate as `FootageView.plate` whose colors are those nearby where it is not reliable."""
    import cv2

    if plate.shape[2] == 3 or plate[..., 3].all():
        return plate
    small = reduced(plate, _HOLE_SIDE)
    smooth = cv2.inpaint(
        np.ascontiguousarray(small[..., :3]), (small[..., 3] < 255).astype(np.uint8), 3, cv2.INPAINT_TELEA
    )
    smooth = cv2.resize(smooth, plate.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.dstack([np.where(plate[..., 3:] > 0, plate[..., :3], smooth), plate[..., 3]])
