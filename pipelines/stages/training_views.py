"""The training views of a frame of the footage."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from pipelines.stages.base import Context, StageReporter
from studio.errors import Message, StudioError

if TYPE_CHECKING:
    from studio.training import TrainingView


def training_views(
    context: Context, reporter: StageReporter, frame: int, reading: Callable[[int, int], None]
) -> list[TrainingView]:
    """Views of all training cameras that see the performer.

    Args:
        context: of the stage.
        reporter: gets a warning for each camera that does not see the performer.
        frame: frame number in the footage.
        reading: called with images read and images before each image; may raise Cancelled.

    Raises:
        StudioError: an image cannot be read, or no camera sees the performer.
    """
    from studio.training import TrainingView

    footage, settings = context.footage.calibrated, context.config.train
    views = []
    for number, camera in enumerate(footage.train_cameras):
        context.cancellation.check()
        reading(number, len(footage.train_cameras))
        view = footage.view(camera, frame)
        if (view.matte > 127).any():
            chroma = None if settings.chroma_siting == "none" else footage.chroma(camera)
            views.append(
                TrainingView.from_view(view, context.device, settings.crop_margin, settings.use_plates, chroma)
            )
        else:
            reporter.warn(
                Message(
                    "training.not_visible",
                    f"{camera} does not see the performer in frame {frame}: not used for this frame",
                    fields={"camera": camera, "frame": int(frame)},
                )
            )
    if not views:
        raise StudioError(
            "matte.all_empty",
            f"no training camera sees the performer in frame {frame}",
            fix="Check the mattes.",
            frame=int(frame),
        )
    return views
