"""The set behind the performer in each camera: the clean plate, or what the footage shows outside of the masks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import cv2
import numpy as np

from v3studio.studio.counts import counted
from v3studio.studio.masks.agreement.empty_set import cover, median_outside
from v3studio.studio.masks.clean_plate import Background
from v3studio.studio.masks.filters import reduced
from v3studio.studio.masks.mask_source import FEWEST_VOTERS, FullMaskSource, Recolors, evenly_spaced
from v3studio.studio.masks.median_background import background_cache

if TYPE_CHECKING:
    from v3studio.studio.footage.footage import Footage

MOST_FRAMES = 15  # that an estimate reads
_FEWEST = 3  # fewer frames do not tell the set from the performer
_LOOKED_AT = 3  # cameras whose set may be plain
_PLAIN, _MOSTLY = 12.0, 0.95  # levels of 255 around one color, and the share of pixels that have it
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
            views = [footage.view(camera, frame) for frame in evenly_spaced(footage.frames, MOST_FRAMES)]
            plate = outside([view.image for view in views], [view.mask for view in views])
        if plate is None or (plate.shape[2] == 4 and not plate[..., 3].any()):
            return np.zeros((0, 0, 3), np.uint8)
        return filled(plate)


def no_set(footage: Footage, sets: EmptySets) -> str:
    """Return why the set cannot be reconstructed from the footage, a clause; "" if it can. Raises StudioError: an image
    or a mask cannot be read."""
    names = footage.train_cameras
    if len(names) < FEWEST_VOTERS:
        return f"it takes {FEWEST_VOTERS} cameras for training, and there are {len(names)}"
    if isinstance(footage.mask_source, FullMaskSource):
        return "without masks, nothing tells it from the performer"
    if isinstance(footage.mask_source, Recolors):
        return "the performer is before a screen"
    if sets.plate(names[0]) is None:
        return f"there are no clean plates, and {counted(len(footage.frames), 'frame')} cannot show it"
    plates = [sets.plate(name) for name in evenly_spaced(names, _LOOKED_AT)]
    return "the footage shows one color around the performer" if all(map(_is_plain, plates)) else ""


def _is_plain(plate: np.ndarray | None) -> bool:
    """Return whether nearly all of a plate has one color."""
    if plate is None:
        return True
    pixels = plate[..., :3][plate[..., 3] > 0] if plate.shape[2] == 4 else plate.reshape(-1, 3)
    middle = np.median(pixels, axis=0) if len(pixels) else 0
    return float((abs(pixels - middle).max(axis=-1) < _PLAIN).mean()) > _MOSTLY if len(pixels) else True


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
    if plate.shape[2] == 3 or plate[..., 3].all():
        return plate
    small = reduced(plate, _HOLE_SIDE)
    smooth = cv2.inpaint(
        np.ascontiguousarray(small[..., :3]), (small[..., 3] < 255).astype(np.uint8), 3, cv2.INPAINT_TELEA
    )
    smooth = cv2.resize(smooth, plate.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.dstack([np.where(plate[..., 3:] > 0, plate[..., :3], smooth), plate[..., 3]])
