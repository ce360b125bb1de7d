"""The views of the footage with which splats are compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipelines.reports.pictures import draw
from pipelines.stages.base import Context
from pipelines.stages.residuals import Residual
from studio.comparison import padded_box

if TYPE_CHECKING:
    from studio.cameras import Camera
    from studio.gaussians import Gaussians


@dataclass(frozen=True, eq=False)
class EvaluatedView:
    """A view of the footage, with the performer over the background.

    Attributes:
        camera: from which splats are drawn.
        box: rows and columns that are measured.
        truth: (h, w, 3) float32 footage in the box, 0 to 1.
    """

    camera: Camera
    box: tuple[slice, slice]
    truth: np.ndarray

    def draw(self, context: Context, gaussians: Gaussians) -> np.ndarray:
        """(h, w, 3) float32 in 0 to 1: splats in the box."""
        return draw(gaussians, self.camera, context.config.capture.background, context.device)[self.box]

    def residual(self, decoded: np.ndarray) -> Residual:
        """Of what was drawn in the box."""
        return Residual(self.box, (decoded - self.truth).astype(np.float16))


def evaluated_view(context: Context, camera: str, frame: int) -> EvaluatedView | None:
    """One view of a frame of the footage, or None if the camera does not see the performer.

    Raises:
        StudioError: an image or mask cannot be read.
    """
    from studio.edits import silhouette

    footage, settings, crop = context.footage.calibrated, context.config, context.edits.crop
    view = footage.view(camera, frame)
    mask = footage.evaluation_mask(camera, frame)
    if crop is not None:
        mask = np.where(silhouette(view.camera, crop), mask, 0).astype(mask.dtype)
    box = padded_box(mask, settings.evaluate.crop_padding)
    if box is None:
        return None
    alpha = mask[box][..., None].astype(np.float32) / 255
    background = np.array(settings.capture.background, dtype=np.float32)
    truth = view.image[box].astype(np.float32) / 255 * alpha + background * (1 - alpha)
    world = context.edits.similarity
    return EvaluatedView(view.camera if world.is_identity else world.camera(view.camera), box, truth)


def evaluated_cameras(context: Context) -> tuple[str, ...]:
    """Those that are compared: held-out ones; training cameras if none is held out."""
    footage = context.footage.calibrated
    return footage.held_out_cameras or footage.train_cameras
