"""Protocols for one camera's image of one frame, as returned by footage. Any object with these members qualifies."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from studio.cameras import Camera


class ViewLike(Protocol):
    """Input of meshing: a pinhole camera, image (H, W, 3) uint8 RGB and mask (H, W) uint8, 255 = foreground."""

    @property
    def camera(self) -> Camera: ...
    @property
    def image(self) -> np.ndarray: ...
    @property
    def mask(self) -> np.ndarray: ...


class CapturedView(ViewLike, Protocol):
    """Input of training: also the clean plate, (H, W, 3) uint8 RGB, or None if the capture has none."""

    @property
    def plate(self) -> np.ndarray | None: ...
