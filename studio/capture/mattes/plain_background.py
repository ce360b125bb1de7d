"""Pictures whose performer was cut out already and put before one plain color, white or black mostly, as data sets of
performers are often given out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from studio.capture.per_camera_cache import PerCameraCache
from studio.errors import StudioError

_BORDER = 4  # pixels all around that are looked at for the color
_UNIFORM = 0.97  # share of them that must have it
_NEAR = 6  # levels that count as the same color there
_STRONG = 40  # levels above which a pixel is surely not background
_MOST = 30  # levels that are forgiven at most
_SPECK = 1e-5  # of the picture: smaller pieces are noise


def plain_color(image: np.ndarray) -> np.ndarray | None:
    """(3,) uint8: the one color that nearly all of the picture's border has, exactly as far as coding leaves it; None
    where there is no such color, or nothing else in the picture. Of what is filmed this is never true.

    Args:
        image: (H, W, 3) uint8.
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
    """What is not of the plain color, soft by one pixel at the outline.

    Patches of the color within the performer are holes (between an arm and the body). How many levels count as the
    same color is found beside the performer, where coding leaves its noise.

    Args:
        image: (H, W, 3) uint8.
        color: (3,) uint8, of the background.

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
    performer = _pieces((difference > min(2 + 3 * noise, _MOST)).astype(np.uint8), _SPECK * matte.size)
    performer = 1 - _pieces(1 - performer, _SPECK * matte.size)
    inner = cv2.erode(performer, np.ones((3, 3), np.uint8), borderValue=1)
    # an outline pixel is as much performer as it differs, beside the most that one next to it does
    most = np.maximum(cv2.dilate(difference * inner, np.ones((5, 5), np.uint8)), difference)
    soft = np.clip(difference.astype(np.float32) / np.maximum(most, 1) * 255 + 0.5, 0, 255).astype(np.uint8)
    matte[part] = np.where(inner > 0, 255, soft * performer)
    return matte


def _pieces(mask: np.ndarray, least: float) -> np.ndarray:
    """The 0/1 mask without its pieces of fewer than `least` pixels."""
    import cv2

    _, labels, figures, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    kept = figures[:, cv2.CC_STAT_AREA] >= max(least, 4)
    kept[0] = False
    return kept.astype(np.uint8)[labels]


class PlainMatteSource:
    """What is not of the plain color behind it; the color is taken off the outline's pixels (see `Recolors`).

    Args:
        first: gives a camera's first picture (H, W, 3) uint8, from which the color is found.
    """

    def __init__(self, first: Callable[[str], np.ndarray]) -> None:
        self._first = first
        self._colors: PerCameraCache[np.ndarray] = PerCameraCache(self._find)

    def _find(self, camera: str) -> np.ndarray:
        color = plain_color(self._first(camera))
        if color is None:
            raise StudioError(
                f"Camera '{camera}': the border of its first picture has not one plain color, so masks cannot be made "
                "of it; choose other masks."
            )
        return color

    def matte(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MatteSource`. Raises StudioError where the camera's first picture has no plain background."""
        return plain_matte(np.ascontiguousarray(image[:, :, :3]), self._colors(camera))

    def recolored(self, camera: str, image: np.ndarray, matte: np.ndarray) -> np.ndarray:
        """See `Recolors`: the performer's own color in mixed pixels, F = (I - (1 - a) B) / a."""
        rows, columns = np.nonzero((matte > 25) & (matte < 255))
        alpha = matte[rows, columns, None].astype(np.float32) / 255
        mixed = image[rows, columns].astype(np.float32) - (1 - alpha) * self._colors(camera)
        result = image.copy()
        result[rows, columns] = np.clip(mixed / alpha + 0.5, 0, 255).astype(np.uint8)
        return result

    def files(self) -> list[Path]:
        """See `MatteSource`."""
        return []
