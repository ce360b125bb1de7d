"""Views of the footage with which splats are compared: the cameras, masks and pixels of the evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.reports.images import render, to_bytes
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.studio.comparison import Behind, ViewPair, behind, padded_box

if TYPE_CHECKING:
    from v3studio.studio.cameras import Camera
    from v3studio.studio.footage import Footage
    from v3studio.studio.gaussians import Gaussians


@dataclass(frozen=True, eq=False)
class ComparedView:
    """A view of the footage. `image`: (H, W, 3) uint8 RGB. `mask`: (H, W) uint8, 255 is the performer; empty if the
    camera has no masks, so that only the uncut image can be compared."""

    camera: Camera
    image: np.ndarray
    mask: np.ndarray
    box: tuple[slice, slice]
    background: tuple[float, float, float]
    device: str
    behind: Behind | None = None  # for comparison with the uncut image, too

    def pair(self, gaussians: Gaussians) -> ViewPair:
        """The footage and these splats, in the box."""
        return ViewPair.of(
            gaussians, self.camera, self.image, self.mask, self.background, self.box, self.device, behind=self.behind
        )


def compared_view(inputs: Inputs, camera: str, frame: int, uncut: bool = False) -> ComparedView | None:
    """One view of a frame of the footage, or None if the camera does not see the performer. `uncut`: to compare
    with the uncut image as well, if the set is known and edits remove nothing."""
    footage, settings, crop = inputs.trained_footage, inputs.config, inputs.edits.crop
    world, view = inputs.edits.similarity, footage.rig[camera]
    place = view if world.is_identity else world.camera(view)
    image, masked = footage.image(camera, frame), camera not in footage.unmasked_cameras
    mask = footage.evaluation_mask(camera, frame) if masked else np.zeros(image.shape[:2], np.uint8)
    if crop is not None:
        mask = crop.cut(view, mask)
    box = padded_box(mask, settings.evaluate.crop_padding)
    if box is None and masked:
        return None
    plate = scene = None
    if uncut and crop is None and not inputs.edits.regions:
        scene = inputs.scene
        plate = inputs.sets.plate(camera) if masked else None
        if plate is None and scene is not None:
            plate = to_bytes(render(scene, place, (0.0, 0.0, 0.0)))
    back = None if plate is None else behind(image, mask, plate, inputs.capture, scene)
    whole = (slice(0, view.height), slice(0, view.width))
    return ComparedView(place, image, mask, box or whole, settings.evaluate.background, inputs.device, back)


def compared_cameras(footage: Footage) -> tuple[str, ...]:
    """Names of the held-out cameras; those of the training cameras if none is held out."""
    return footage.measured_cameras or footage.train_cameras


def performer_over(footage: Footage, camera: str, frame: int, background: Sequence[float]) -> np.ndarray:
    """The performer as filmed, undistorted, over a background, as in the evaluation: (H, W, 3) uint8 RGB."""
    alpha = footage.evaluation_mask(camera, frame)[..., None].astype(np.float32) / 255
    color = np.array(background, np.float32) * 255
    image = footage.image(camera, frame).astype(np.float32) * alpha + color * (1 - alpha)
    return (image + 0.5).astype(np.uint8)
