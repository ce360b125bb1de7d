"""Masks of images in which the performer has already been cut out and placed on a plain color, usually white or black,
as in many published data sets.
"""

import math
from functools import cached_property

import numpy as np

from v3studio.studio.errors import StudioError
from v3studio.studio.masks.filters import largest_channel
from v3studio.studio.masks.mask_source import MaskInputs, MaskSource, evenly_spaced
from v3studio.studio.memory_cache import MemoryCache

_CAMERAS = 9  # most cameras that are looked at for the color of all
_BORDER = 4  # width in pixels of the border in which the color is measured
_UNIFORM = 0.97  # fraction of the border that must have the color if the performer is not cut off
_SIDE = 0.5  # fraction of each of three sides that must have it otherwise: more than most letterbox bars
_SHARED = 0.01  # fraction of an image that must have the other cameras' color
_NEAR = 6  # largest difference in levels that counts as the same color there
_STRONG = 40  # difference in levels above which a pixel is certainly foreground
_MOST = 30  # largest tolerance in levels
_SPECK = 1e-5  # fraction of the image; smaller components are noise


def plain_color(image: np.ndarray, cut_off: bool = True) -> np.ndarray | None:
    """The plain background color (3,) uint8 of an image (H, W, 3) uint8, from its border; None if there is none, or if
    the image contains nothing else.

    Nearly all of the border must have the same color, except for compression artifacts, which is never the case in
    camera footage. If the performer may be `cut_off` by the image's edge, half of three sides is enough.
    """
    parts = (image[:_BORDER], image[-_BORDER:], image[:, :_BORDER], image[:, -_BORDER:])
    sides = [part.reshape(-1, 3).astype(np.int16) for part in parts]
    border = np.concatenate(sides)
    color = np.median(border, axis=0).astype(np.uint8)
    near = _near(border, color)
    shares = sorted(float(_near(side, color).mean()) for side in sides)
    uniform = near.mean() >= _UNIFORM or (cut_off and shares[1] >= _SIDE)
    if not uniform or np.abs(border[near] - color).mean() > 1:
        return None
    small = image[::4, ::4].astype(np.int16)
    return color if (np.abs(small - color).max(axis=2) > _STRONG).any() else None


def _near(pixels: np.ndarray, color: np.ndarray) -> np.ndarray:
    difference: np.ndarray = np.abs(pixels.astype(np.int16) - color).max(axis=-1)
    return difference <= _NEAR


def plain_mask(image: np.ndarray, color: np.ndarray) -> np.ndarray:
    """Mask (H, W) uint8, 255 = performer, of everything in an image (H, W, 3) uint8 that differs from the background's
    color (3,) uint8, soft by one pixel at the outline.

    Areas of that color inside the performer are holes (for example, between an arm and the body). The tolerance is
    derived from the compression noise next to the performer.
    """
    import cv2

    difference = largest_channel(cv2.absdiff(image, np.broadcast_to(color, image.shape).copy()))
    strong = (difference > _STRONG).astype(np.uint8)
    box = cv2.boundingRect(strong)  # left, top, width, height
    left, top = max(0, box[0] - 32), max(0, box[1] - 32)
    part = (slice(top, box[1] + box[3] + 32), slice(left, box[0] + box[2] + 32))
    mask = np.zeros(image.shape[:2], np.uint8)
    if not box[2]:
        return mask
    difference, strong = np.ascontiguousarray(difference[part]), np.ascontiguousarray(strong[part])
    around = cv2.dilate(strong, np.ones((25, 25), np.uint8)) > cv2.dilate(strong, np.ones((9, 9), np.uint8))
    noise = float(np.percentile(difference[around], 75)) if around.any() else 0.0
    performer = _without_specks((difference > min(2 + 3 * noise, _MOST)).astype(np.uint8), _SPECK * mask.size)
    performer = 1 - _without_specks(1 - performer, _SPECK * mask.size)
    inner = cv2.erode(performer, np.ones((3, 3), np.uint8), borderValue=1)
    # alpha of an outline pixel: its difference relative to the largest one next to it
    most = np.maximum(cv2.dilate(difference * inner, np.ones((5, 5), np.uint8)), difference)
    soft = np.clip(difference.astype(np.float32) / np.maximum(most, 1) * 255 + 0.5, 0, 255).astype(np.uint8)
    mask[part] = np.where(inner > 0, 255, soft * performer)
    return mask


def _without_specks(mask: np.ndarray, least: float) -> np.ndarray:
    """The 0/1 mask without components that have fewer than `least` pixels."""
    import cv2

    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    kept = stats[:, cv2.CC_STAT_AREA] >= max(least, 4)
    kept[0] = False
    return kept.astype(np.uint8)[labels]


class PlainMaskSource(MaskSource):
    """A `MaskSource` whose foreground is everything that differs from a plain background color.

    The background color is also removed from the outline (see `Recolors`).

    That color is measured in each camera's first image. Where the performer hides most of the border, or is not yet in
    the image, it is that of most others.
    """

    def __init__(self, inputs: MaskInputs) -> None:
        self._inputs = inputs
        self._colors: MemoryCache[str, np.ndarray] = MemoryCache(math.inf)

    def color(self, camera: str) -> np.ndarray:
        """(3,) uint8: the plain background of the camera's images. Raises StudioError `mask.not_plain`."""
        return self._colors.get_or_make(camera, self._find)

    def _find(self, camera: str) -> np.ndarray:
        image = self._inputs.first_image(camera)
        color = plain_color(image)
        if color is None:
            shared = self._shared
            color = shared if shared is not None and _near(image[::4, ::4], shared).mean() >= _SHARED else None
        if color is None:
            problem = (
                f"Camera '{camera}': its first image has neither a border of one plain color nor that of most others"
            )
            fix = "Choose another source of masks in capture.masks."
            raise StudioError("mask.not_plain", problem, fix=fix, camera=camera, setting="capture.masks")
        return color

    @cached_property
    def _shared(self) -> np.ndarray | None:
        """The color of most of up to nine cameras; None if fewer than half agree."""
        colors = [
            plain_color(self._inputs.first_image(camera)) for camera in evenly_spaced(self._inputs.names, _CAMERAS)
        ]
        known = [color for color in colors if color is not None]
        for color in known:
            if 2 * sum(bool(_near(other, color)) for other in known) >= max(2, len(colors)):
                return color
        return None

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """The mask as `MaskSource.mask` describes it. Raises StudioError `mask.not_plain`."""
        return plain_mask(np.ascontiguousarray(image[:, :, :3]), self.color(camera))

    def recolored(self, camera: str, image: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """The image with the performer's color in mixed pixels, F = (I - (1 - a) B) / a; see `Recolors`."""
        rows, columns = np.nonzero((mask > 25) & (mask < 255))
        alpha = mask[rows, columns, None].astype(np.float32) / 255
        mixed = image[rows, columns].astype(np.float32) - (1 - alpha) * self.color(camera)
        result = image.copy()
        result[rows, columns] = np.clip(mixed / alpha + 0.5, 0, 255).astype(np.uint8)
        return result


def open_plain(inputs: MaskInputs, required: bool) -> tuple[MaskSource, str] | None:
    """Open masks from a plain background, for `SOURCES`."""
    source = PlainMaskSource(inputs)
    if not required and not _is_plain(inputs, source):
        return None
    return source, "difference from the plain background"


def _is_plain(inputs: MaskInputs, source: PlainMaskSource) -> bool:
    """Return whether the images show the performer cut out on a plain color, according to up to nine cameras.

    In at least half of them, the performer must not be cut off; in the others the color must be the same.
    """
    some = evenly_spaced(inputs.names, _CAMERAS)
    try:
        whole = sum(plain_color(inputs.first_image(camera), cut_off=False) is not None for camera in some)
        if 2 * whole < len(some):
            return False
        for camera in some:
            source.color(camera)
    except StudioError:  # not plain; or an unreadable file, which is reported when it is needed
        return False
    return True
