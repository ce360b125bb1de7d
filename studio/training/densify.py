"""Density control of the keyframe: splats are split where several views agree that the image is wrong."""

import torch

from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer.contribution import contribution
from v3studio.studio.torch_rotations import rotate_vectors
from v3studio.studio.training.details import detail_weights
from v3studio.studio.training.settings import TrainSettings
from v3studio.studio.training.splat_optimizer import SplatOptimizer
from v3studio.studio.training.step import Stepper

_VIEWS = 10  # views that decide on each densification, as in FastGS
_MIN_OPACITY = 0.005
RESET_EVERY = 3_000  # steps between opacity resets, as in 3DGS; there are none in the last quarter of densification
_RESET_OPACITY = 0.01
_HUGE_SHARE = 0.1  # splats larger than this fraction of the scene extent are removed


def control_density(
    iteration: int, optimizer: SplatOptimizer, stepper: Stepper, extent: float, settings: TrainSettings
) -> None:
    """Split and remove splats and reset opacities if due, so that their number grows to the maximum in equal steps.

    3DGS (Kerbl et al. 2023, section 5.2) splits where gradients are large, which in few steps they rarely are, and any
    one view can cause them. Here, as in FastGS (Ren et al. 2025), views vote with their errors.

    Args:
        iteration: counts from 1.
        stepper: its views are compared with the splats.
        extent: scene extent, world units.
    """
    due = settings.densify_from < iteration < settings.densify_until and iteration % settings.densify_every == 0
    if due:
        times = -(-(settings.densify_until - iteration) // settings.densify_every)
        count = -(-max(0, settings.densify_max_splats - len(optimizer)) // times)
        densify(optimizer, stepper, extent, count, remove_huge=iteration > RESET_EVERY)
    last_reset = settings.densify_until - settings.densify_until // 4
    if iteration % RESET_EVERY == 0 and iteration <= last_reset:
        optimizer.cap_opacity(_RESET_OPACITY)


@torch.no_grad()
def densify(optimizer: SplatOptimizer, stepper: Stepper, extent: float, count: int, remove_huge: bool) -> None:
    """Split up to `count` splats once, and remove faint and huge ones."""
    gaussians = optimizer.gaussians.detach()
    views, generator = stepper.views, stepper.generator
    drawn = torch.randperm(len(views), generator=generator)[:_VIEWS].tolist()
    errors = torch.stack(
        [
            contribution(gaussians, [view.camera], [stepper.error(gaussians, view)])
            for view in (views[number] for number in drawn)
        ]
    )
    # without the largest of several: what a single view sees is not the splat's
    agreed = errors.sum(0) - errors.amax(0) if len(errors) > 1 else errors[0]
    score = agreed * detail_weights(gaussians.means, views[0].details)
    chosen = torch.argsort(score, descending=True, stable=True)[:count]
    split = torch.zeros(len(gaussians), dtype=torch.bool, device=score.device)
    split[chosen[score[chosen] > 0]] = True
    optimizer.append(_halves(gaussians[split], generator))
    after = optimizer.gaussians.detach()
    keep = after.opacities > _MIN_OPACITY
    keep[: len(gaussians)] &= ~split
    if remove_huge:
        keep &= after.scales.amax(-1) < _HUGE_SHARE * extent
    optimizer.keep(keep)


def _halves(gaussians: Gaussians, generator: torch.Generator) -> Gaussians:
    """Two children per splat, with means sampled from its distribution and scales 1.6 times smaller, as in 3DGS."""
    twice = Gaussians.cat(gaussians, gaussians)
    draws = torch.randn(twice.means.shape, generator=generator).to(twice.device) * twice.scales
    twice.means = twice.means + rotate_vectors(twice.unit_quats, draws)
    twice.log_scales = twice.log_scales - torch.log(torch.tensor(1.6))
    return twice
