"""How much of the pictures, and of their errors, each splat accounts for.

Bulò et al., "Revising Densification in Gaussian Splatting", 2024, section 3.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from studio.gaussians import SH_C0, Gaussians
from studio.rasterizer import rasterize
from studio.training.views import TrainingView, interior

_GRAY = 0.5
"""Background of the pictures that are compared: neither dark nor bright."""


@dataclass(frozen=True)
class Shares:
    """Sums over views and pixels, in pixels.

    Attributes:
        weight: (N,) blending weight of each splat.
        error: (N,) blending weight times the error of the pixel, the mean absolute difference of RGB (0 to 1). Only
            pixels inside the performer count.
    """

    weight: Tensor
    error: Tensor


def shares(gaussians: Gaussians, views: Sequence[TrainingView]) -> Shares:
    """Draw all views and divide each pixel's weight and error among the splats that it shows.

    A splat's blending weights are the derivative of the picture by its color, so one backward pass gives both sums.

    Args:
        gaussians: N splats, on the device of the views.
        views: to compare with, at least one.
    """
    gaussians = gaussians.detach()
    gray = torch.zeros(len(gaussians), 1, 3, device=gaussians.device, requires_grad=True)
    colorless = replace(gaussians, sh=gray)
    for view in views:
        error = picture_error(gaussians, view)
        drawn = rasterize(colorless, view.camera).image
        (drawn[..., 0].sum() + (drawn[..., 1] * error).sum()).backward()  # type: ignore[no-untyped-call]
    assert gray.grad is not None
    sums = gray.grad[:, 0].clamp_min(0) / SH_C0
    return Shares(sums[:, 0], sums[:, 1])


@torch.no_grad()
def picture_error(gaussians: Gaussians, view: TrainingView) -> Tensor:
    """(H, W) mean absolute difference of RGB between drawing and footage.

    0 at and outside the performer's outline, where errors come from masks, and more splats do not help.
    """
    background = torch.full((3,), _GRAY, device=view.device)
    backdrop = view.backdrop(background)
    behind = background if backdrop is None else backdrop
    render = rasterize(gaussians, view.camera, behind)
    image = view.in_its_colors(render.image, render.alpha, behind)
    error = (image - view.composited(background)).abs().mean(-1)
    return error * interior(view.mask)
