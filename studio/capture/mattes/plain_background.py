"""Mattes of images in which the performer has already been cut out and placed on a plain color, usually white or black,
as in many published data sets.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from studio.capture.per_camera_cache import PerCameraCache
from studio.errors import StudioError

_BORDER = 4  # width in pixels of the border in which the color is measured
_UNIFORM = 0.97  # fraction of the border that must have the color
_NEAR = 6  # largest difference in levels that counts as the same color there
_STRONG = 40  # difference in levels above which a pixel is certainly foreground
_MOST = 30  # largest tolerance in levels
_SPECK = 1e-5  # fraction of the image; smaller components are noise


def plain_color(image: np.ndarray) -> np.ndarray | None:
    """The plain background color of an image, from its border.

    Nearly all of the border must have the same color, except for compression artifacts, which is never the case in
    camera footage.

    Args:
        image: (H, W, 3) uint8.

    Returns:
        (3,) uint8; None if there is no such color, or if the image contains nothing else.
    """
    border = np.concatenate(
        [part.reshape(-1, 3) for part in (image[:_BORDER], image[-_BORDER:], image[:, :_BORDER], image[:, -_BORDER:])]
    )
    color = np.median(border, axis=0).astype(np.uint8)
    near = np.abs(border.astype(np.int16) - color).max(axis=1) <= _NEAR
    if near.mean() < _UNIFORM or np.abs(border[near].astype(np.int16) - color).mean() > 1:
        return None
    small = image[::4, ::4].astype(np.int16)
    return color if (np.abs(small - color).max(axis=2) > _STRONG).any() else None


def plain_matte(image: np.ndarray, color: np.ndarray) -> np.ndarray:
    """Matte of everything that differs from a plain color, soft by one pixel at the outline.

    Areas of that color inside the performer are holes (for example, between an arm and the body). The tolerance is
    derived from the compression noise next to the performer.

    Args:
        image: (H, W, 3) uint8.
        color: (3,) uint8 color of the background.

    Returns:
        (H, W) uint8, 255 = performer.
    """
    import cv2

    difference = np.ascontiguousarray(cv2.absdiff(image, np.broadcast_to(color, image.shape).copy()).max(axis=2))
    strong = (difference > _STRONG).astype(np.uint8)
    box = cv2.boundingRect(strong)  # left, top, width, height
    left, top = max(0, box[0] - 32), max(0, box[1] - 32)
    part = (slice(top, box[1] + box[3] + 32), slice(left, box[0] + box[2] + 32))
    matte = np.zeros(image.shape[:2], np.uint8)
    if not box[2]:
        return matte
    difference, strong = np.ascontiguousarray(difference[part]), np.ascontiguousarray(strong[part])
    around = cv2.dilate(strong, np.ones((25, 25), np.uint8)) > cv2.dilate(strong, np.ones((9, 9), np.uint8))
    noise = float(np.percentile(difference[around], 75)) if around.any() else 0.0
    performer = _without_specks((difference > min(2 + 3 * noise, _MOST)).astype(np.uint8), _SPECK * matte.size)
    performer = 1 - _without_specks(1 - performer, _SPECK * matte.size)
    inner = cv2.erode(performer, np.ones((3, 3), np.uint8), borderValue=1)
    # alpha of an outline pixel: its difference relative to the largest one next to it
    most = np.maximum(cv2.dilate(difference * inner, np.ones((5, 5), np.uint8)), difference)
    soft = np.clip(difference.astype(np.float32) / np.maximum(most, 1) * 255 + 0.5, 0, 255).astype(np.uint8)
    matte[part] = np.where(inner > 0, 255, soft * performer)
    return matte


def _without_specks(mask: np.ndarray, least: float) -> np.ndarray:
    """The 0/1 mask without components that have fewer than `least` pixels."""
    import cv2

    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    kept = stats[:, cv2.CC_STAT_AREA] >= max(least, 4)
    kept[0] = False
    return kept.astype(np.uint8)[labels]


class PlainMatteSource:
    """A `MatteSource` whose foreground is everything that differs from a plain background color.

    The background color is also removed from the outline (see `Recolors`).

    Args:
        first: returns a camera's first image (H, W, 3) uint8, in which the background color is measured.
    """

    def __init__(self, first: Callable[[str], np.ndarray]) -> None:
        self._first = first
        self._colors: PerCameraCache[np.ndarray] = PerCameraCache(self._find)

    def _find(self, camera: str) -> np.ndarray:
        color = plain_color(self._first(camera))
        if color is None:
            raise StudioError(
                "matte.not_plain",
                f"Camera '{camera}': the border of its first image does not have one plain color",
                fix="Choose another source of masks in capture.masks.",
                camera=camera,
                setting="capture.masks",
            )
        return color

    def matte(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MatteSource`. Raises StudioError `matte.not_plain`."""
        return plain_matte(np.ascontiguousarray(image[:, :, :3]), self._colors(camera))

    def recolored(self, camera: str, image: np.ndarray, matte: np.ndarray) -> np.ndarray:
        """See `Recolors`: the performer's color in mixed pixels, F = (I - (1 - a) B) / a."""
        rows, columns = np.nonzero((matte > 25) & (matte < 255))
        alpha = matte[rows, columns, None].astype(np.float32) / 255
        mixed = image[rows, columns].astype(np.float32) - (1 - alpha) * self._colors(camera)
        result = image.copy()
        result[rows, columns] = np.clip(mixed / alpha + 0.5, 0, 255).astype(np.uint8)
        return result

    def files(self) -> list[Path]:
        """See `MatteSource`."""
        return []
