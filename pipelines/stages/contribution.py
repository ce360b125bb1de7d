"""What each splat of a group adds to the pictures of the training cameras."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pipelines.stages.base import Context

if TYPE_CHECKING:
    from studio.cameras import Camera
    from studio.gaussians import Gaussians


class DrawnContribution:
    """What each splat adds to the pictures of the training cameras, for rungs with fewer splats.

    Measured in the first, the middle and the last frame, from all training cameras.

    Args:
        context: of the stage.
        frames: of the group, read on access.
        cameras: the training cameras, in the world of the frames.
    """

    WIDTH = 640

    def __init__(self, context: Context, frames: Sequence[Gaussians], cameras: Sequence[Camera]) -> None:
        self._context, self._frames, self._cameras = context, frames, cameras

    def __call__(self) -> np.ndarray:
        """(N,) float64: sum over views of the splat's blending weights."""
        from studio.rasterizer.contribution import contribution

        context, count = self._context, len(self._frames)
        total: np.ndarray | None = None
        for position in sorted({0, count // 2, count - 1}):
            gaussians = self._frames[position]
            for camera in self._cameras:
                context.cancellation.check()
                if camera.width > self.WIDTH:
                    camera = camera.scaled(self.WIDTH / camera.width)
                found = contribution(gaussians.to(context.device), camera)
                total = found if total is None else total + found
        assert total is not None
        return total
