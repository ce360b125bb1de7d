"""A soft foreground matte from an image before a screen of one color.

Steps: evidence a pixel (the angle between its color and the screen's, in units of what the screen and the noise show;
and what is far darker than any shadow), smoothing along the image's edges, the clean-up that difference mattes get, and
at the silhouette a matte solved from the screen as it is seen beside the performer: I = a F + (1 - a) B.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from studio.capture.mattes.clean_plate import DifferenceSettings, noise_of, solve_edges
from studio.capture.mattes.despill import despill
from studio.capture.mattes.filters import guided_filter, keep_components
from studio.capture.mattes.garbage_mattes import GarbageMattes
from studio.capture.mattes.screen_color import Screen, find_screen
from studio.capture.per_camera_cache import PerCameraCache

SAMPLES = 5
"""Frames of a camera that its screen's color is found from."""

_WORK_SIDE = 1920  # evidence is gathered at this size; edges are solved at full size
_FLOOR = 0.06  # tangent of an angle that reflections and compression may turn the screen's color by
_DEEPEST_SHADOW = 0.3  # of the screen's light around; what is darker has no color to tell it by
_NO_SHADOW = 0.75


def chroma_matte(
    image: np.ndarray, screen: Screen, settings: DifferenceSettings | None = None, inside: np.ndarray | None = None
) -> np.ndarray:
    """Foreground matte of `image` before `screen`.

    Args:
        image: (H, W, 3) uint8 RGB.
        screen: see `find_screen`.
        settings: as of difference mattes; None is the defaults.
        inside: (H, W) bool, where the performer may be; nothing outside is foreground. None is everywhere.

    Returns:
        (H, W) uint8, 255 foreground, soft at the edges.
    """
    import cv2

    settings = settings or DifferenceSettings()
    height, width = image.shape[:2]
    shrink = min(1.0, _WORK_SIDE / max(height, width))
    small, small_inside = image, inside
    if shrink < 1.0:
        size = (max(1, round(width * shrink)), max(1, round(height * shrink)))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        if inside is not None:
            small_inside = cv2.resize(inside.astype(np.uint8), size, interpolation=cv2.INTER_AREA) > 0
    mask = _binary(small.astype(np.float32), screen, settings, small_inside)
    if not mask.any():
        return np.zeros((height, width), np.uint8)
    if shrink < 1.0:
        full = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
        mask = (full > 0.5).astype(np.uint8)
    reach = edge_reach(image)
    behind = screen_behind(image, mask)
    matte = solve_edges(image, behind, np.ones(3, np.float32), mask, reach, known=None)
    return matte if inside is None else matte * inside.astype(np.uint8)


def key_evidence(image: np.ndarray, screen: Screen, settings: DifferenceSettings) -> np.ndarray:
    """Log-odds of foreground from color.

    Args:
        image: (H, W, 3) float32 RGB in 0..255.

    Returns:
        (H, W) float32, between -4 (the screen) and 6 (surely not).
    """
    import cv2

    soft = cv2.GaussianBlur(image, (0, 0), 0.8)
    noise = float(noise_of(image - cv2.blur(image, (3, 3))).mean()) / 2.2  # what the blur leaves of it
    tangents, along = screen.tangents(soft)
    angle = tangents[..., 0] ** 2 + tangents[..., 1] ** 2
    variance = screen.spread**2 + _FLOOR**2 + (noise / along) ** 2
    by_angle = 1.2 * (np.sqrt(angle / variance) * settings.sensitivity - 4.0)
    # The screen's light around each pixel, from what is surely screen. Shadows belong to it where they are no matter.
    typical = float(np.linalg.norm(screen.color))
    least, reach = (_DEEPEST_SHADOW, 0.04) if settings.shadows else (_NO_SHADOW, 0.2)
    plain = ((by_angle < -1.0) & (along > _DEEPEST_SHADOW * typical)).astype(np.uint8)
    everywhere = np.array([typical], np.float32)
    light = _spread_out(along[..., None], plain, reach * max(image.shape[:2]), everywhere)[..., 0]
    by_darkness = 40.0 * (least * min(settings.sensitivity, 1.3) - along / light)
    return np.clip(np.maximum(by_angle, by_darkness), -4.0, 6.0).astype(np.float32)


def _binary(image: np.ndarray, screen: Screen, settings: DifferenceSettings, inside: np.ndarray | None) -> np.ndarray:
    """(H, W) uint8 0 or 1 of a float32 image; see `chroma_matte`."""
    import cv2

    evidence = key_evidence(image, screen, settings)
    if inside is not None:
        evidence[~inside] = -4.0
    gray = np.ascontiguousarray(cv2.transform(image, np.full((1, 3), 1 / 765.0, np.float32)))
    smooth = guided_filter(gray, evidence, radius=2, epsilon=4e-4)
    mask = (smooth > 0.0).astype(np.uint8)
    return keep_components(mask, settings.components, int(1e-4 * mask.size), core=evidence > 4.0)


def edge_reach(image: np.ndarray) -> float:
    """Pixels around the silhouette that may be mixed colors, of an image (H, W, ...): 2 up to 1920 pixels wide."""
    return 2.0 * max(1.0, max(image.shape[:2]) / _WORK_SIDE)


def screen_behind(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: the screen as it would be seen without the performer, from what is seen of it beside him.

    Args:
        image: (H, W, 3) uint8 RGB.
        mask: (H, W) uint8, 1 = performer.
    """
    import cv2

    reach = edge_reach(image)
    radius = int(np.ceil(1.5 * reach))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    plain = 1 - cv2.dilate(mask, disc)
    everywhere = image[plain > 0] if plain.any() else image.reshape(-1, 3)
    middle = np.median(everywhere[::17], axis=0).astype(np.float32)
    found = _spread_out(image.astype(np.float32), plain, 3 * reach, middle)
    return np.rint(np.clip(found, 0, 255)).astype(np.uint8)


def _spread_out(values: np.ndarray, where: np.ndarray, sigma: float, otherwise: np.ndarray) -> np.ndarray:
    """Local mean of (H, W, C) `values` where `where` is 1, carried on over the rest: near ones count most.

    Means over `sigma`, then over 4 and 16 times as much where that sees too few; `otherwise` (C,) where nothing is.
    """
    import cv2

    height, width = where.shape
    result: np.ndarray = np.broadcast_to(otherwise, values.shape).astype(np.float32)
    for factor in (16.0, 4.0, 1.0):
        shrink = min(1.0, 4.0 / (factor * sigma))  # a wide mean needs no pixels
        size = (max(1, round(width * shrink)), max(1, round(height * shrink)))
        weight = cv2.resize(where.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        weighted = cv2.resize(values * where[..., None].astype(np.float32), size, interpolation=cv2.INTER_AREA)
        weighted = weighted.reshape(*weight.shape, -1) / np.maximum(weight, 1e-6)[..., None]
        mean, seen = _weighted_mean(weighted, weight, factor * sigma * shrink)
        mean = cv2.resize(mean, (width, height), interpolation=cv2.INTER_LINEAR).reshape(values.shape)
        seen = cv2.resize(seen, (width, height), interpolation=cv2.INTER_LINEAR)[..., None]
        trust = seen / (seen + 0.02)
        result = trust * mean + (1.0 - trust) * result
    return result


def _weighted_mean(values: np.ndarray, weight: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    import cv2

    total = cv2.GaussianBlur(values * weight[..., None], (0, 0), sigma).reshape(values.shape)
    seen = cv2.GaussianBlur(weight, (0, 0), sigma)
    return total / np.maximum(seen, 1e-6)[..., None], seen


class ChromaMatteSource:
    """What is not of the screen's color.

    Args:
        read: gives the raw picture (H, W, 3) uint8 RGB of a camera and frame.
        frames: gives a camera's frame numbers, from which a few are looked at for the screen's color.
        key_color: RGB in 0..1; None finds it, for each camera.
        settings: as of difference mattes.
        garbage: what is looked at; None is everything.
    """

    def __init__(
        self,
        read: Callable[[str, int], np.ndarray],
        frames: Callable[[str], Sequence[int]],
        key_color: Sequence[float] | None = None,
        settings: DifferenceSettings | None = None,
        garbage: GarbageMattes | None = None,
    ) -> None:
        self._read, self._frames = read, frames
        self._key_color = key_color
        self._settings = settings or DifferenceSettings()
        self._garbage = garbage
        self.screen: PerCameraCache[Screen] = PerCameraCache(self._find)

    def _find(self, camera: str) -> Screen:
        frames = self._frames(camera)
        chosen = sorted({round(place) for place in np.linspace(0, len(frames) - 1, SAMPLES)})
        return find_screen([self._read(camera, frames[index]) for index in chosen], camera, self._key_color)

    def matte(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MatteSource`. Raises StudioError where the camera shows no screen."""
        image = np.ascontiguousarray(image[:, :, :3])
        inside = self._garbage.inside(camera, frame, image) if self._garbage is not None else None
        return chroma_matte(image, self.screen(camera), self._settings, inside)

    def files(self) -> list[Path]:
        """See `MatteSource`."""
        return self._garbage.files() if self._garbage is not None else []


class DespillingMatteSource(ChromaMatteSource):
    """The same, and the screen's light is taken off the performer's outline (see `Recolors`)."""

    def recolored(self, camera: str, image: np.ndarray, matte: np.ndarray) -> np.ndarray:
        """See `Recolors`."""
        behind = screen_behind(image, (matte > 127).astype(np.uint8))
        return despill(image, matte, behind, self.screen(camera).color)
