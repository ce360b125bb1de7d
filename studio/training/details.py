"""Details: parts of the performer, as face and hands, that count more than the rest in training.

Their pixels weigh more in the loss, and their splats where splats are added (densification) and taken away (pruning).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from v3studio.studio.cameras import Camera
from v3studio.studio.training.photometric import photometric_loss


@dataclass(frozen=True)
class Detail:
    """A ball around a part of the performer.

    Attributes:
        center: its middle, world units.
        radius: above 0, world units.
        weight: how much more it counts than the rest, at least 1.
    """

    center: tuple[float, float, float]
    radius: float
    weight: float


@dataclass(frozen=True)
class DetailBox:
    """The bounding box of a detail in an image, pixels; `right` and `bottom` are the first pixels outside."""

    left: int
    top: int
    right: int
    bottom: int
    weight: float

    def of(self, image: Tensor) -> Tensor:
        """The part of an (H, W, C) image."""
        return image[self.top : self.bottom, self.left : self.right]


def detail_boxes(camera: Camera, details: Sequence[Detail]) -> tuple[DetailBox, ...]:
    """The boxes of the details that a camera sees; it may be behind other parts of the performer."""
    boxes = []
    for detail in details:
        pixels, depth = camera.project(np.array([detail.center], np.float64))
        if depth[0] <= detail.radius:
            continue
        x, y = pixels[0]
        across, down = (focal * detail.radius / depth[0] for focal in (camera.fx, camera.fy))
        left, right = (int(np.clip(edge, 0, camera.width)) for edge in (np.floor(x - across), np.ceil(x + across)))
        top, bottom = (int(np.clip(edge, 0, camera.height)) for edge in (np.floor(y - down), np.ceil(y + down)))
        if left < right and top < bottom:
            boxes.append(DetailBox(left, top, right, bottom, detail.weight))
    return tuple(boxes)


def detail_loss(
    image: Tensor, target: Tensor, box: DetailBox, dssim_weight: float, closer: Sequence[Tensor] = ()
) -> Tensor:
    """The part that the weight of a detail adds to the photometric loss of an image.

    With it, the L1 part of the loss is that of pixels with these weights, and so is SSIM, but for the windows at the
    edges of a box. Weights of boxes that overlap add up.

    Args:
        closer: image and target of the box alone, with more pixels, which are compared instead.
    """
    share = (box.right - box.left) * (box.bottom - box.top) / (image.shape[0] * image.shape[1])
    of_box, of_target = closer or (box.of(image), box.of(target))
    return (box.weight - 1) * share * photometric_loss(of_box, of_target, dssim_weight)


def detail_weights(means: Tensor, details: Sequence[Detail]) -> Tensor:
    """(N,) weight of each of the (N, 3) means: that of the heaviest detail around it, 1 outside of all."""
    weights = torch.ones(len(means), dtype=means.dtype, device=means.device)
    for detail in details:
        inside = (means.detach() - means.new_tensor(detail.center)).norm(dim=-1) <= detail.radius
        weights = torch.where(inside, weights.clamp_min(detail.weight), weights)
    return weights
