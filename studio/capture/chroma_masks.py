"""The `Matter` of footage before a coloured screen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from studio.capture.chroma import chroma_matte, screen_behind
from studio.capture.despill import despill
from studio.capture.difference import DifferenceSettings
from studio.capture.garbage import GarbageMattes
from studio.capture.once import PerCamera
from studio.capture.screen import Screen, find_screen

SAMPLES = 5
"""Frames of a camera that its screen's colour is found from."""


class ChromaMatter:
    """What is not of the screen's colour.

    Args:
        read: gives the raw picture (H, W, 3) uint8 RGB of a camera and frame.
        frames: gives a camera's frame numbers, from which a few are looked at for the screen's colour.
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
        self.screen: PerCamera[Screen] = PerCamera(self._find)

    def _find(self, camera: str) -> Screen:
        frames = self._frames(camera)
        chosen = sorted({round(place) for place in np.linspace(0, len(frames) - 1, SAMPLES)})
        return find_screen([self._read(camera, frames[index]) for index in chosen], camera, self._key_color)

    def matte(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `Matter`. Raises StudioError where the camera shows no screen."""
        image = np.ascontiguousarray(image[:, :, :3])
        inside = self._garbage.inside(camera, frame, image) if self._garbage is not None else None
        return chroma_matte(image, self.screen(camera), self._settings, inside)

    def files(self) -> list[Path]:
        """See `Matter`."""
        return self._garbage.files() if self._garbage is not None else []


class DespillingMatter(ChromaMatter):
    """The same, and the screen's light is taken off the performer's outline (see `Recolors`)."""

    def recolored(self, camera: str, image: np.ndarray, matte: np.ndarray) -> np.ndarray:
        """See `Recolors`."""
        behind = screen_behind(image, (matte > 127).astype(np.uint8))
        return despill(image, matte, behind, self.screen(camera).color)
