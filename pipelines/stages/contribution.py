"""What each splat of a trained group adds to the pictures of the training cameras."""

from __future__ import annotations

import numpy as np

from pipelines.stages.base import Context
from pipelines.takes.frame_files import read_frame


class DrawnContribution:
    """What each splat adds to the pictures of the training cameras, for rungs with fewer splats.

    Measured in the first, the middle and the last frame, from all training cameras.

    Args:
        context: of the stage.
        group: index of the trained group.
        indices: its frames, or some of them, counted from 0 in the take.
    """

    WIDTH = 640

    def __init__(self, context: Context, group: int, indices: range) -> None:
        self._context, self._group, self._indices = context, group, indices

    def __call__(self) -> np.ndarray:
        """(N,) float64: sum over views of the splat's blending weights."""
        from studio.rasterizer.contribution import contribution

        context, count = self._context, len(self._indices)
        footage = context.footage.calibrated
        total: np.ndarray | None = None
        for position in sorted({0, count // 2, count - 1}):
            gaussians = read_frame(context.take.trained_frame(self._group, self._indices[position]))
            for name in footage.train_cameras:
                context.cancellation.check()
                camera = footage.rig[name]
                if camera.width > self.WIDTH:
                    camera = camera.scaled(self.WIDTH / camera.width)
                found = contribution(gaussians.to(context.device), camera)
                total = found if total is None else total + found
        assert total is not None
        return total
