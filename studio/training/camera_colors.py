"""Color differences between cameras: a 3x4 matrix and a vignette per camera, fitted to what splats draw.

Cameras of real rigs differ in exposure, white balance and sensor. Splats without correction learn the mean of all
cameras, and view-dependent color or floaters where they can. With it, each camera sees the splats through its own
matrix, which includes exposure. The matrices are ridge least squares solutions, refitted now and then while splats
train: gradient descent on them fails, since each camera is visited too rarely.

Only differences between cameras are determined. The mean of all matrices is therefore kept neutral, so that splats
have the colors of the mean camera. A vignette has no such freedom: in the middle of an image its gain is 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from studio.color_fit import correct_color, fit_color, neutral
from studio.gaussians import Gaussians
from studio.progress import ProgressFn, no_progress
from studio.rasterizer import rasterize
from studio.training.keyframe import initial_gaussians, scene_extent
from studio.training.settings import TrainSettings
from studio.training.splat_optimizer import SplatOptimizer
from studio.training.step import Stepper, check_finite
from studio.training.views import TrainingView, interior
from studio.vignette import Vignette, fit_color_and_vignette, radius_squared

RIDGE = 1e-3
"""Weight of the squared difference from neutral against the mean squared error of colors in 0 to 1."""

LEAST_SURE = 3.0
"""A vignette is used if it makes the squared error of pixels to which it was not fitted smaller by this many standard
errors, taken over blocks of pixels: less is noise and shading."""

LEAST_CHANGE = 0.01
"""And if it changes brightness by at least this somewhere: less is not seen."""

_BLOCKS = 92
"""Blocks along the diagonal of the image, by turns fitted to and held back: 8 pixels wide at 640x360."""

_FIGURES_EVERY = 20


@dataclass(frozen=True)
class FittedColors:
    """The colors of cameras, in the order of the views that they were fitted to.

    Attributes:
        matrices: (V, 3, 4) float64, on the CPU; their mean is neutral. See `studio.color_fit.correct_color`.
        vignettes: V vignettes, which apply after the matrices; None where there is none.
    """

    matrices: Tensor
    vignettes: tuple[Vignette | None, ...]

    def applied(self, views: Sequence[TrainingView]) -> list[TrainingView]:
        """The views, by cameras with these colors."""
        return [view.with_color(*one) for view, *one in zip(views, self.matrices, self.vignettes, strict=True)]


def fit_camera_colors(
    views: Sequence[TrainingView],
    points: Tensor,
    colors: Tensor,
    settings: TrainSettings,
    *,
    seed: int = 0,
    progress: ProgressFn = no_progress,
) -> FittedColors:
    """Train splats for `settings.camera_color_iterations` steps and fit the cameras' colors to them.

    Args:
        views: training views of a keyframe, one per camera.
        points: (N, 3) initial means, world units.
        colors: (N, 3) RGB of the points, 0 to 1.
        settings: see `TrainSettings`; the splats have one color each, whatever `sh_degree` is, because color that
            depends on the view would explain the cameras' differences.
        seed: equal seeds and inputs give equal colors, bit for bit.
        progress: called with completed and total steps, and regularly also with `loss`.

    Raises:
        StudioError: as `train_keyframe`.
        Cancelled: raised by `progress`.
    """
    generator = torch.Generator().manual_seed(seed)
    extent = scene_extent(points)
    stepper = Stepper(views, settings, generator)
    optimizer = SplatOptimizer(initial_gaussians(points, colors, 0, settings.dilation), settings.rates, extent)
    found = FittedColors(neutral().expand(len(views), 3, 4), (None,) * len(views))
    steps, every = settings.camera_color_iterations, settings.camera_color_every
    for iteration in range(1, steps + 1):
        optimizer.set_means_progress(iteration / steps)
        gaussians = optimizer.gaussians
        step = stepper(gaussians, dropout=True)
        loss = step.loss
        if settings.opacity_reg:
            loss = loss + settings.opacity_reg * gaussians.opacities.mean()
        if settings.scale_reg:
            loss = loss + settings.scale_reg / extent * gaussians.scales.mean()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        figures = {}
        if iteration % _FIGURES_EVERY == 0:
            check_finite(step.loss, "keyframe")
            figures = {"loss": float(step.loss.detach())}
        progress(iteration, steps, **figures)
        if iteration % every == 0 or iteration == steps:
            found = camera_colors(optimizer.gaussians.detach(), views, settings.camera_vignettes)
            stepper.views = found.applied(views)
    return found


def camera_colors(gaussians: Gaussians, views: Sequence[TrainingView], vignettes: bool = True) -> FittedColors:
    """Colors of each view, fitted inside the performer to what the splats draw.

    A view in which the performer is too thin to have an inside is fitted to all of the performer.

    Args:
        gaussians: splats in the colors of the mean camera.
        views: one per camera.
        vignettes: False fits matrices alone.
    """
    found = [_camera_color(gaussians, view, vignettes) for view in views]
    matrices = torch.stack([matrix for matrix, _ in found])
    return FittedColors(matrices - matrices.mean(0) + neutral(), tuple(vignette for _, vignette in found))


@torch.no_grad()
def _camera_color(gaussians: Gaussians, view: TrainingView, vignettes: bool) -> tuple[Tensor, Vignette | None]:
    black = torch.zeros(3, device=view.device)
    render = rasterize(gaussians, view.camera, black)
    image, alpha, target, backdrop = render.image, render.alpha, view.composited(black), view.backdrop(black)
    if backdrop is not None:
        target = target - (1 - alpha)[..., None] * backdrop
    inside = interior(view.mask)
    if not vignettes:
        return fit_color(image, alpha, target, inside, RIDGE).cpu(), None
    r2 = radius_squared(view.camera, view.full_size, view.device)

    blocks = _blocks(inside, view.full_size)
    held_back = inside & (blocks.sum(0) % 2 == 1)
    fitted_to = inside & ~held_back
    alone = correct_color(image, alpha, fit_color(image, alpha, target, fitted_to, RIDGE))
    matrix, tried = fit_color_and_vignette(image, alpha, target, r2, fitted_to, RIDGE)
    both = correct_color(image, alpha, matrix) * tried.gain_at(r2)[..., None]
    less = ((alone - target).square() - (both - target).square()).sum(-1)
    if _sure(less[held_back], blocks[:, held_back]) >= LEAST_SURE:
        matrix, used = fit_color_and_vignette(image, alpha, target, r2, inside, RIDGE)
        if float((used.gain_at(r2) - 1)[inside].abs().max()) >= LEAST_CHANGE:
            return matrix.cpu(), used
    return fit_color(image, alpha, target, inside, RIDGE).cpu(), None


def _blocks(like: Tensor, full_size: tuple[int, int]) -> Tensor:
    """(2, H, W) int64 row and column of each pixel's block."""
    side = max(4, round(math.hypot(*full_size) / _BLOCKS))
    rows, columns = (torch.arange(size, device=like.device) // side for size in like.shape)
    return torch.stack(torch.meshgrid(rows, columns, indexing="ij"))


def _sure(values: Tensor, blocks: Tensor) -> float:
    """How many standard errors the mean over blocks of `values` (P) is above 0; `blocks`: (2, P). 0 for one block."""
    found, number = torch.unique(blocks, dim=1, return_inverse=True)
    count = found.shape[1]
    if count < 2:
        return 0.0
    sums = torch.zeros(count, dtype=torch.float64, device=values.device).index_put_(
        (number,), values.double(), accumulate=True
    )
    return float(sums.mean() / (sums.std() / math.sqrt(count)).clamp_min(1e-12))
