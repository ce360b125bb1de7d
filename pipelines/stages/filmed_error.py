"""Errors of trained and decoded frames against the footage, for `bake.max_loss`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pipelines.stages.base import Context
from pipelines.stages.evaluated_view import EvaluatedView, evaluated_cameras, evaluated_view

if TYPE_CHECKING:
    from studio.gaussians import Gaussians


class FilmedError:
    """Squared errors against the footage, in the views of the evaluation.

    These are the held-out cameras. Splats are fitted closer to training cameras than to any other view, so the same
    error of encoding counts for more there: a limit of 0.4 dB took twice the bytes. Without held-out cameras, they are
    training cameras. At most four cameras, evenly spaced in their order.

    Args:
        context: of the stage.
        frames: the trained frames of the group, with the take's edits.
        numbers: their frame numbers in the footage.

    Attributes:
        losses: dB that encoding costs, by index in the group, as last measured.
    """

    CAMERAS = 4

    def __init__(self, context: Context, frames: Sequence[Gaussians], numbers: Sequence[int]) -> None:
        self._context, self._frames, self._numbers = context, frames, numbers
        names = evaluated_cameras(context)
        chosen = np.linspace(0, len(names), min(self.CAMERAS, len(names)), endpoint=False).astype(int)
        self._names = [names[index] for index in chosen]
        self._trained: dict[int, float] = {}
        self.losses: dict[int, float] = {}

    def __call__(self, index: int, decoded: Gaussians) -> tuple[float, float]:
        """Errors of the trained and of the decoded frame, as geometric means over the cameras, so that their ratio is
        the mean of what the cameras lose in dB; `index` counts within the group.

        Raises:
            StudioError: an image cannot be read.
            Cancelled: the run was cancelled.
        """
        from studio.stream.frame_losses import loss

        self._context.cancellation.check()
        found = [evaluated_view(self._context, name, self._numbers[index]) for name in self._names]
        views = [view for view in found if view is not None]
        if index not in self._trained:
            self._trained[index] = self._error(self._frames[index], views)
        errors = self._trained[index], self._error(decoded, views)
        self.losses[index] = loss(*errors)
        return errors

    def _error(self, gaussians: Gaussians, views: Sequence[EvaluatedView]) -> float:
        if not views:
            return 0.0
        errors = [np.square(view.draw(self._context, gaussians) - view.truth).mean(dtype=np.float64) for view in views]
        return float(np.exp(np.mean(np.log(np.maximum(errors, 1e-12)))))
