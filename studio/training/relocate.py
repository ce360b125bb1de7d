"""The densification strategy `mcmc`: relocation of dead splats, and exploration noise.

Kheradmand et al., "3D Gaussian Splatting as Markov Chain Monte Carlo", 2024.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from studio.gaussians import Gaussians
from studio.torch_rotations import rotate_vectors
from studio.training.details import Detail, detail_weights
from studio.training.settings import TrainSettings
from studio.training.splat_optimizer import SplatOptimizer

_DEAD = 0.005  # splats at or below this opacity are dead
_GROWTH = 1.05  # maximum growth factor per densification step
_MOST_COPIES = 51
_NOISE_RATE = 5e5
_NOISE_SHARPNESS, _NOISE_OPACITY = 100.0, 0.005


class Relocation:
    """Moves dead splats onto live ones, sampled in proportion to opacity, and adds splats up to the maximum.

    When a splat becomes N copies, their opacities and scales are chosen so that the render does not change (equation
    9). Noise on the means of nearly transparent splats makes them explore (equation 8).

    Args:
        settings: uses `densify_from`, `densify_until`, `densify_every` and `densify_max_splats`.
        details: where splats are sampled in proportion to opacity times weight.
    """

    def __init__(self, settings: TrainSettings, details: Sequence[Detail] = ()) -> None:
        self._settings, self._details = settings, details

    @torch.no_grad()
    def after_step(self, iteration: int, optimizer: SplatOptimizer, generator: torch.Generator) -> None:
        """Relocate and grow if due, then add noise; `iteration` counts from 1."""
        settings = self._settings
        if settings.densify_from < iteration < settings.densify_until and iteration % settings.densify_every == 0:
            relocate_dead(optimizer, generator, self._details)
            grow(optimizer, settings.densify_max_splats, generator, self._details)
        add_noise(optimizer, generator)


def shared_opacity_and_scale(opacity: Tensor, copies: Tensor) -> tuple[Tensor, Tensor]:
    """Opacity (M,), and factor of scales, of N (1 to 51) copies that look like one splat (equation 9)."""
    new = 1 - (1 - opacity) ** (1 / copies)
    denominator = torch.zeros_like(new)
    for i in range(1, int(copies.max()) + 1):
        for k in range(i):
            term = math.comb(i - 1, k) * (-1) ** k / math.sqrt(k + 1) * new ** (k + 1)
            denominator = denominator + torch.where(copies >= i, term, 0.0)
    return new, opacity / denominator


def relocate_dead(optimizer: SplatOptimizer, generator: torch.Generator, details: Sequence[Detail] = ()) -> None:
    """Move each dead splat onto a live one."""
    gaussians = optimizer.gaussians.detach()
    opacities = gaussians.opacities
    dead = (opacities <= _DEAD).nonzero()[:, 0]
    alive = (opacities > _DEAD).nonzero()[:, 0]
    if len(dead) == 0 or len(alive) == 0:
        return
    chances = opacities * detail_weights(gaussians.means, details)
    chosen = alive[_draw(chances[alive], len(dead), generator)]
    shared = _shared(gaussians, chosen)
    optimizer.overwrite(chosen, shared)
    optimizer.overwrite(dead, shared)


def grow(optimizer: SplatOptimizer, budget: int, generator: torch.Generator, details: Sequence[Detail] = ()) -> None:
    """Add 5% more splats as copies of live ones, up to `budget` in total."""
    count = len(optimizer)
    more = min(budget, int(_GROWTH * count)) - count
    if more <= 0:
        return
    gaussians = optimizer.gaussians.detach()
    chosen = _draw(gaussians.opacities * detail_weights(gaussians.means, details), more, generator)
    shared = _shared(gaussians, chosen)
    optimizer.overwrite(chosen, shared)
    optimizer.append(shared)


def add_noise(optimizer: SplatOptimizer, generator: torch.Generator) -> None:
    """Add noise with the splat's own covariance to the means of nearly transparent splats (equation 8)."""
    gaussians = optimizer.gaussians.detach()
    share = torch.sigmoid(-_NOISE_SHARPNESS * (gaussians.opacities - _NOISE_OPACITY))
    draws = torch.randn(gaussians.means.shape, generator=generator).to(gaussians.device)
    quats = gaussians.unit_quats
    inverse = quats * quats.new_tensor([1, -1, -1, -1])
    noise = rotate_vectors(quats, rotate_vectors(inverse, draws) * gaussians.scales**2)
    optimizer.shift_means(noise * (share * _NOISE_RATE * optimizer.means_rate)[:, None])


def _draw(chances: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """`count` indices, sampled with replacement in proportion to (N,) `chances`."""
    # torch.multinomial is limited to 2^24 categories
    edges = chances.double().cumsum(0).cpu()
    draws = torch.rand(count, generator=generator, dtype=torch.float64) * edges[-1]
    return torch.searchsorted(edges, draws).clamp(max=len(edges) - 1).to(chances.device)


def _shared(gaussians: Gaussians, chosen: Tensor) -> Gaussians:
    copies = (torch.bincount(chosen, minlength=len(gaussians))[chosen] + 1).clamp(max=_MOST_COPIES)
    picked = gaussians[chosen]
    opacity, factor = shared_opacity_and_scale(picked.opacities, copies)
    opacity = opacity.clamp(_DEAD, 1 - 1e-6)
    log_scales = picked.log_scales + factor.log()[:, None]
    return replace(picked, log_scales=log_scales, logit_opacities=torch.logit(opacity))
