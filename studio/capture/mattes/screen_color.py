"""The colored screen behind a performer: finding its color in a camera's footage.

A screen is told by its direction in RGB: less light scales a color toward black and leaves the direction, so wrinkles
and shadows of the screen stay screen. Colors are compared by the tangents of their angles to that direction.
"""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from studio.errors import StudioError

_SIDE = 320  # longest side while looking for the color
_HUES = 72  # bins of 5 degrees
_NEAR = 0.25  # tangent of the angle within which a color may be a given key color: 14 degrees
_LEAST_SHARE = 0.12  # of the picture, border counted twice, that an unasked-for screen must cover
_LEAST_SATURATION = 0.3


@dataclass(frozen=True, eq=False)
class Screen:
    """What is known of a camera's screen.

    Attributes:
        color: (3,) float32 RGB in 0..255, its median.
        spread: tangent of the angle by which its colors lie apart (robust standard deviation on each axis).
    """

    color: np.ndarray
    spread: float

    @cached_property
    def axes(self) -> np.ndarray:
        """(3, 3) float32 orthonormal rows: the color's direction, and two across it."""
        along = self.color.astype(np.float64) / np.linalg.norm(self.color)
        start = np.zeros(3)
        start[int(along.argmin())] = 1.0
        first = start - (start @ along) * along
        first /= np.linalg.norm(first)
        return np.stack([along, first, np.cross(along, first)]).astype(np.float32)

    def tangents(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far colors point away from the screen's, and how bright they are along it.

        Args:
            image: (H, W, 3) float32 RGB in 0..255.

        Returns:
            (H, W, 2) tangents on the two axes across, 0 on the screen under any light; (H, W) length along its
            direction, at least 1.
        """
        import cv2

        turned = cv2.transform(image, self.axes)
        along = np.maximum(turned[..., 0], 1.0)
        return turned[..., 1:] / along[..., None], along


def find_screen(images: Sequence[np.ndarray], camera: str, key_color: Sequence[float] | None = None) -> Screen:
    """The screen's color as one camera sees it.

    Args:
        images: a few frames, (H, W, 3) uint8 RGB.
        camera: its name, for the messages.
        key_color: about what color to look for, RGB in 0..1; None takes the hue that covers most of the picture in
            saturated colors, where the border counts twice (the performer seldom stands there).

    Raises:
        StudioError: no saturated color covers enough; nothing in the pictures is like `key_color`.
    """
    import cv2

    pixels, weights = [], []
    for image in images:
        shrink = min(1.0, _SIDE / max(image.shape[:2]))
        size = (max(1, round(image.shape[1] * shrink)), max(1, round(image.shape[0] * shrink)))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        weight = np.full(small.shape[:2], 2.0, np.float32)
        margin = max(1, round(0.12 * min(small.shape[:2])))
        weight[margin:-margin, margin:-margin] = 1.0
        pixels.append(small.reshape(-1, 3))
        weights.append(weight.reshape(-1))
    colors, weight = np.concatenate(pixels), np.concatenate(weights)
    if key_color is None:
        chosen = _dominant(colors, weight, camera)
    else:
        wanted = Screen(255.0 * np.asarray(key_color, np.float32), 0.0)
        tangents, along = wanted.tangents(colors[None])
        near = (np.hypot(tangents[0, :, 0], tangents[0, :, 1]) < _NEAR) & (along[0] > 20)
        if near.mean() < 0.01:
            raise StudioError(
                f"Camera '{camera}': nothing in its picture is like key_color {_words(255 * np.asarray(key_color))}; "
                "give the screen's color as this footage shows it, or auto."
            )
        chosen = colors[near]
    return _screen_of(chosen)


def _dominant(colors: np.ndarray, weight: np.ndarray, camera: str) -> np.ndarray:
    """(N, 3): those of `colors` that have the hue which covers most. Raises StudioError where none covers enough."""
    high, low = colors.max(axis=1), colors.min(axis=1)
    saturation = (high - low) / np.maximum(high, 1.0)
    vivid = (saturation > _LEAST_SATURATION) & (high > 30)
    chosen = vivid
    share = 0.0
    if vivid.any():
        hue = _hue(colors)
        index = (hue * _HUES).astype(np.int64) % _HUES
        votes = np.bincount(index[vivid], weights=(weight * saturation)[vivid], minlength=_HUES)
        smooth = sum(np.roll(votes, step) for step in (-2, -1, 0, 1, 2))
        peak = (int(np.argmax(smooth)) + 0.5) / _HUES
        apart = np.abs((hue - peak + 0.5) % 1.0 - 0.5)
        chosen = vivid & (apart < 4 / _HUES)
        share = float(weight[chosen].sum() / weight.sum())
    if share < _LEAST_SHARE:
        most = f"the most common one, {_words(np.median(colors[chosen], axis=0))}, covers" if share else "they cover"
        raise StudioError(
            f"Camera '{camera}': no saturated color dominates its picture ({most} {100 * share:.0f} % of it), so no "
            "screen was found; give key_color, or another kind of masks."
        )
    return colors[chosen]


def _hue(colors: np.ndarray) -> np.ndarray:
    """(N,) hue in 0..1 of (N, 3) float32 colors."""
    import cv2

    hsv = cv2.cvtColor(colors[None] / np.float32(255.0), cv2.COLOR_RGB2HSV)
    return hsv[0, :, 0] / 360.0


def _screen_of(colors: np.ndarray) -> Screen:
    """The screen of (N, 3) colors, most of which are its own; strays of like hue are left out."""
    for _ in range(3):
        middle = np.median(colors / np.maximum(colors.sum(axis=1, keepdims=True), 1.0), axis=0)
        screen = Screen((middle * np.median(colors.sum(axis=1))).astype(np.float32), 0.0)
        tangents, _ = screen.tangents(colors[None])
        spread = float(max(1.4826 * np.median(np.abs(tangents[0]), axis=0).max(), 0.01))
        near = np.hypot(tangents[0, :, 0], tangents[0, :, 1]) < 4 * spread
        if near.all():
            break
        colors = colors[near]
    return Screen(screen.color, spread)


def saturated(color: Sequence[float]) -> bool:
    """Whether a color (RGB in 0..1) is one that a screen can be told by."""
    _, saturation, value = colorsys.rgb_to_hsv(*color)
    return saturation >= _LEAST_SATURATION and value > 0.1


def _words(color: np.ndarray) -> str:
    """[0.10, 0.60, 0.20] of an RGB color in 0..255."""
    return "[" + ", ".join(f"{value / 255:.2f}" for value in color) + "]"
