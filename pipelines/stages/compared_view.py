"""Views of the footage with which rendered splats are compared: one way to make such a pair of images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipelines.reports.pictures import draw
from pipelines.stages.inputs import Inputs
from studio.comparison import flicker, padded_box

if TYPE_CHECKING:
    from studio.cameras import Camera
    from studio.gaussians import Gaussians


@dataclass(frozen=True, eq=False)
class Residual:
    """Decoded minus footage in the box of a view, kept from one frame to the next to measure flicker.

    Attributes:
        box: rows and columns of the image.
        values: (h, w, 3) float16, colors in 0 to 1.
    """

    box: tuple[slice, slice]
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class ComparedView:
    """A view of the footage, with the performer over the background.

    Attributes:
        camera: from which splats are rendered.
        box: rows and columns that are measured.
        footage: (h, w, 3) float32 image in the box, 0 to 1.
        background: RGB, 0 to 1.
        device: torch device to render on.
    """

    camera: Camera
    box: tuple[slice, slice]
    footage: np.ndarray
    background: tuple[float, float, float]
    device: str

    def render(self, gaussians: Gaussians) -> np.ndarray:
        """(h, w, 3) float32 in 0 to 1: splats in the box."""
        return draw(gaussians, self.camera, self.background, self.device)[self.box]

    def residual(self, decoded: np.ndarray) -> Residual:
        """Of what was rendered in the box."""
        return Residual(self.box, (decoded - self.footage).astype(np.float16))


def compared_view(inputs: Inputs, camera: str, frame: int) -> ComparedView | None:
    """One view of a frame of the footage, or None if the camera does not see the performer.

    Raises:
        StudioError: an image or mask cannot be read.
    """
    from studio.edits import silhouette

    footage, settings, crop = inputs.footage.calibrated, inputs.config, inputs.edits.crop
    view = footage.view(camera, frame)
    mask = footage.evaluation_mask(camera, frame)
    if crop is not None:
        mask = np.where(silhouette(view.camera, crop), mask, 0).astype(mask.dtype)
    box = padded_box(mask, settings.evaluate.crop_padding)
    if box is None:
        return None
    alpha = mask[box][..., None].astype(np.float32) / 255
    background = settings.capture.background
    color = np.array(background, dtype=np.float32)
    image = view.image[box].astype(np.float32) / 255 * alpha + color * (1 - alpha)
    world = inputs.edits.similarity
    place = view.camera if world.is_identity else world.camera(view.camera)
    return ComparedView(place, box, image, background, inputs.device)


def compared_cameras(inputs: Inputs) -> tuple[str, ...]:
    """Names of the held-out cameras; those of the training cameras if none is held out."""
    footage = inputs.footage.calibrated
    return footage.held_out_cameras or footage.train_cameras


def flicker_of(before: Mapping[str, Residual], now: Mapping[str, Residual]) -> float | None:
    """Flicker between two consecutive frames where the boxes overlap, mean over cameras, in levels of 0 to 255.

    Args:
        before, now: by camera.

    Returns:
        None if no camera has the performer in both frames.
    """
    found = []
    for camera in sorted(set(before) & set(now)):
        one, other = before[camera], now[camera]
        spans = [(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(one.box, other.box, strict=True)]
        if all(start < stop for start, stop in spans):
            parts = []
            for each in (one, other):
                rows, columns = (
                    slice(start - side.start, stop - side.start)
                    for (start, stop), side in zip(spans, each.box, strict=True)
                )
                parts.append(each.values[rows, columns].astype(np.float32))
            found.append(flicker(*parts))
    return round(sum(found) / len(found), 4) if found else None
