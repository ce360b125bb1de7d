"""The color of the screen behind a performer, estimated per camera.

A screen is described by a direction in RGB space: with less light, a color moves toward black but keeps its direction,
so wrinkled and shaded parts of the screen still match. Colors are compared by the tangent of their angle to it.
"""

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from v3studio.studio.capture.settings import LEAST_SATURATION
from v3studio.studio.errors import StudioError
from v3studio.studio.masks.filters import reduced
from v3studio.studio.settings import Color

_SIDE = 320  # longest side of the images in which the color is estimated
_HUES = 72  # bins of 5 degrees
_NEAR = 0.25  # tangent of the largest angle between a color and a given key color: 14 degrees
_KEYED = {"green": (85.0, 160.0), "blue": (205.0, 255.0)}  # hues of screens, in degrees
_LEAST_VIVID = 0.5  # saturation of a screen that is found without being asked for; a green table had 0.48
_MOST_SPREAD = 0.06  # of its colors; areas that only happen to be green or blue have more
_MOST_APART = 12.0  # degrees between the hue in a camera and that in others
_MOST_CAMERAS = 0.7  # share of the cameras that must see the screen
_LEAST_SHARE = 0.12  # fraction of the image, border counted twice, that a screen must cover to be detected


@dataclass(frozen=True, eq=False)
class Screen:
    """The screen as seen by one camera: median RGB in 0..255, and deviation of its colors' tangents per axis."""

    color: np.ndarray
    spread: float

    @cached_property
    def axes(self) -> np.ndarray:
        """(3, 3) float32 orthonormal rows: the direction of the color, and two directions perpendicular to it."""
        along = self.color.astype(np.float64) / np.linalg.norm(self.color)
        start = np.zeros(3)
        start[int(along.argmin())] = 1.0
        first = start - (start @ along) * along
        first /= np.linalg.norm(first)
        return np.stack([along, first, np.cross(along, first)]).astype(np.float32)

    def tangents(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directions of colors (H, W, 3) float32 RGB in 0..255 relative to the screen's: (H, W, 2) tangents along the
        two perpendicular axes, 0 for the screen under any light; and (H, W) length along its direction, at least 1."""
        import cv2

        rotated = cv2.transform(image, self.axes)
        along = np.maximum(rotated[..., 0], 1.0)
        return rotated[..., 1:] / along[..., None], along


def find_screen(images: Sequence[np.ndarray], camera: str, key_color: Sequence[float] | None = None) -> Screen:
    """Estimate the screen's color in one camera from a few of its images, (H, W, 3) uint8 RGB.

    `key_color`: approximate RGB in 0..1; None: the saturated hue that covers most of the image, with the border counted
    twice (the performer is rarely there). StudioError: `mask.no_screen`: no saturated color covers enough of the image;
    `mask.key_color_not_found`.
    """
    pixels, weights = [], []
    for image in images:
        small = reduced(image, _SIDE).astype(np.float32)
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
            problem = f"Camera '{camera}': no part of the image matches key_color {_text(255 * np.asarray(key_color))}"
            value = tuple(key_color)
            fix = "Set capture.key_color to the screen's color in this footage, or to auto."
            raise StudioError(
                "mask.key_color_not_found", problem, value=value, fix=fix, camera=camera, setting="capture.key_color"
            )
        chosen = colors[near]
    return _screen_of(chosen)


def certain_screen(images: Sequence[np.ndarray], cameras: Sequence[str]) -> tuple[str, Color] | None:
    """The color of the screen that most cameras show in their image, (H, W, 3) uint8 RGB: "green" or "blue", and its
    RGB in 0..1. It must be saturated, uniform in each camera, and the same in them. None: there may be no screen."""
    hues, colors = [], []
    for image, camera in zip(images, cameras, strict=True):
        try:
            screen = find_screen([image], camera)
        except StudioError:
            continue
        hue, saturation, _ = colorsys.rgb_to_hsv(*(float(value) for value in screen.color))
        if saturation >= _LEAST_VIVID and screen.spread <= _MOST_SPREAD:
            hues.append(360 * hue)
            colors.append(screen.color)
    if not hues:
        return None
    middle = float(np.median(hues))
    same = [color for hue, color in zip(hues, colors, strict=True) if abs(hue - middle) < _MOST_APART]
    name = next((name for name, (low, high) in _KEYED.items() if low < middle < high), "")
    if not name or len(same) < _MOST_CAMERAS * len(cameras):
        return None
    red, green, blue = (np.median(same, axis=0) / 255).tolist()
    return name, (red, green, blue)


def _dominant(colors: np.ndarray, weight: np.ndarray, camera: str) -> np.ndarray:
    """(N, 3): the `colors` of the dominant hue. Raises StudioError `mask.no_screen` if it covers too little."""
    import cv2

    high, low = colors.max(axis=1), colors.min(axis=1)
    saturation = (high - low) / np.maximum(high, 1.0)
    vivid = (saturation > LEAST_SATURATION) & (high > 30)
    chosen = vivid
    share = 0.0
    if vivid.any():
        hue: np.ndarray = cv2.cvtColor(colors[None] / np.float32(255.0), cv2.COLOR_RGB2HSV)[0, :, 0] / 360.0
        index = (hue * _HUES).astype(np.int64) % _HUES
        votes = np.bincount(index[vivid], weights=(weight * saturation)[vivid], minlength=_HUES)
        smooth = sum(np.roll(votes, step) for step in (-2, -1, 0, 1, 2))
        peak = (int(np.argmax(smooth)) + 0.5) / _HUES
        apart = np.abs((hue - peak + 0.5) % 1.0 - 0.5)
        chosen = vivid & (apart < 4 / _HUES)
        share = float(weight[chosen].sum() / weight.sum())
    if share < _LEAST_SHARE:
        most = f"the most common, {_text(np.median(colors[chosen], axis=0))}, covers" if share else "they cover"
        problem = (
            f"Camera '{camera}': no screen found; no saturated color dominates the image ({most} {100 * share:.0f}%)"
        )
        fix = "Set capture.key_color, or choose another source of masks in capture.masks."
        raise StudioError("mask.no_screen", problem, value=share, fix=fix, camera=camera, setting="capture.key_color")
    return colors[chosen]


def _screen_of(colors: np.ndarray) -> Screen:
    """The screen from (N, 3) colors, most of which belong to it; outliers of similar hue are removed."""
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


def _text(color: np.ndarray) -> str:
    """An RGB color in 0..255 as text, such as [0.10, 0.60, 0.20]."""
    return "[" + ", ".join(f"{value / 255:.2f}" for value in color) + "]"
