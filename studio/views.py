"""The form in which footage hands out what one camera saw at one moment: any object with these members will do."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from studio.cameras import Camera


class ViewLike(Protocol):
    """What meshing needs: a pinhole camera, image (H, W, 3) uint8 RGB and matte (H, W) uint8, 255 = foreground."""

    @property
    def camera(self) -> Camera: ...
    @property
    def image(self) -> np.ndarray: ...
    @property
    def matte(self) -> np.ndarray: ...


class CapturedView(ViewLike, Protocol):
    """What training needs: also the empty set, (H, W, 3) uint8 RGB, or None where the capture has no clean plate."""

    @property
    def plate(self) -> np.ndarray | None: ...
