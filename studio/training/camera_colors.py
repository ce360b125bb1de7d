"""Color differences between cameras: a 3x4 matrix per camera, fitted to the rendered splats.

Cameras of real rigs differ in exposure, white balance and sensor. Splats without correction learn the mean of all
cameras, and view-dependent color or floaters where they can. With it, each camera sees the splats through its own
matrix, which includes exposure. The matrices are ridge least squares solutions, refitted now and then while splats
train: gradient descent on them fails, since each camera is visited too rarely.

Only differences between cameras are determined. The mean of all matrices is therefore kept neutral, so that splats
have the colors of the mean camera.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from v3studio.studio.color_fit import fit_color, neutral
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.training.keyframe import initial_gaussians, scene_extent
from v3studio.studio.training.settings import TrainSettings
from v3studio.studio.training.splat_optimizer import SplatOptimizer
from v3studio.studio.training.step import Stepper, regularized
from v3studio.studio.training.views import TrainingView, interior

RIDGE = 1e-3  # weight of the squared difference from neutral against the mean squared error of colors in 0 to 1
STEPS = 600  # training steps to whose splats the matrices are fitted
EVERY = 150  # steps after which they are fitted again


def fit_camera_colors(
    views: Sequence[TrainingView],
    points: Tensor,
    colors: Tensor,
    settings: TrainSettings,
    *,
    seed: int = 0,
    progress: ProgressFn = no_progress,
) -> Tensor:
    """Train splats for a few hundred steps and fit the cameras' colors to them.

    Args:
        views: training views of a keyframe, one per camera.
        points: (N, 3) initial means, world units.
        colors: (N, 3) RGB of the points, 0 to 1.
        settings: see `TrainSettings`; the splats have one color each, whatever `sh_degree` is, because color that
            depends on the view would explain the cameras' differences.
        seed: equal seeds and inputs give equal colors, bit for bit.
        progress: called with completed and total steps, and regularly also with figures.

    Returns:
        (V, 3, 4) float64 matrices, see `camera_colors`.

    Raises:
        StudioError: as `train_keyframe`.
        Cancelled: raised by `progress`.
    """
    generator = torch.Generator().manual_seed(seed)
    extent = scene_extent(points)
    stepper = Stepper(views, settings, generator)
    optimizer = SplatOptimizer(initial_gaussians(points, colors, 0, settings.dilation), settings.rates, extent)
    matrices = neutral().expand(len(views), 3, 4)
    for iteration in range(1, STEPS + 1):
        optimizer.set_means_progress(iteration / STEPS)
        gaussians = optimizer.gaussians
        step = stepper(gaussians, dropout=True)
        regularized(step.loss, gaussians, settings, extent).backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        progress(iteration, STEPS, **step.figures(iteration, "keyframe", len(gaussians)))
        if iteration % EVERY == 0:
            matrices = camera_colors(optimizer.gaussians.detach(), views)
            stepper.views = [view.with_color(matrix) for view, matrix in zip(views, matrices, strict=True)]
    return matrices


@torch.no_grad()
def camera_colors(gaussians: Gaussians, views: Sequence[TrainingView]) -> Tensor:
    """Color matrices of the views, fitted inside the performer to the rendered splats.

    A view in which the performer is too thin to have an inside is fitted to all of the performer.

    Returns:
        (V, 3, 4) float64, on the CPU; their mean is neutral. See `studio.color_fit.correct_color`.
    """
    matrices = []
    for view in views:
        black = torch.zeros(3, device=view.device)
        render = rasterize(gaussians, view.camera, black)
        target, behind = view.over(black)
        target = target - (1 - render.alpha)[..., None] * behind
        matrices.append(fit_color(render.image, render.alpha, target, interior(view.mask), RIDGE).cpu())
    fitted = torch.stack(matrices)
    return fitted - fitted.mean(0) + neutral()
