"""Density control by relocation (Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte Carlo")."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from studio.gaussians import Gaussians
from studio.torch_rotations import rotate_vectors
from studio.training.settings import TrainSettings
from studio.training.splat_optimizer import SplatOptimizer

_DEAD = 0.005
"""Opacity under which a splat is dead."""
_GROWTH = 1.05
"""More splats at most, each time."""
_MOST_COPIES = 51
_NOISE_RATE = 5e5
_NOISE_SHARPNESS, _NOISE_OPACITY = 100.0, 0.005


class Relocation:
    """Moves dead splats onto live ones, drawn in proportion to their opacity, and grows up to the budget.

    A splat that becomes N shares its opacity and size among them so that the picture stays the same (equation 9 there);
    noise on the positions of nearly transparent splats lets them explore (equation 8).

    Args:
        settings: `densify_from`, `densify_until`, `densify_every`, `densify_max_splats`, `mcmc_noise`.
    """

    wants_screen_gradients = False

    def __init__(self, settings: TrainSettings) -> None:
        self._settings = settings

    def observe(self, *_: object) -> None:
        """Nothing: relocation looks at opacities only."""

    @torch.no_grad()
    def after_step(self, iteration: int, optimizer: SplatOptimizer, generator: torch.Generator) -> None:
        """Relocate and grow where it is time to, then add noise; `iteration` counts from 1."""
        settings = self._settings
        if settings.densify_from < iteration < settings.densify_until and iteration % settings.densify_every == 0:
            relocate_dead(optimizer, generator)
            grow(optimizer, settings.densify_max_splats, generator)
        if settings.mcmc_noise:
            add_noise(optimizer, settings.mcmc_noise, generator)

    def state(self) -> dict[str, Tensor]:
        """Nothing to remember."""
        return {}

    def restore(self, state: dict[str, Tensor]) -> None:
        """Nothing to restore."""


def shared_opacity_and_scale(opacity: Tensor, copies: Tensor) -> tuple[Tensor, Tensor]:
    """What each of N splats at one place must have to look like the one that stood there (equation 9).

    Args:
        opacity: (M,) of the one, in 0 to 1.
        copies: (M,) int, N from 1 to 51.

    Returns:
        (M,) opacity of each, (M,) factor for its scales.
    """
    new = 1 - (1 - opacity) ** (1 / copies)
    denominator = torch.zeros_like(new)
    for i in range(1, int(copies.max()) + 1):
        for k in range(i):
            term = math.comb(i - 1, k) * (-1) ** k / math.sqrt(k + 1) * new ** (k + 1)
            denominator = denominator + torch.where(copies >= i, term, 0.0)
    return new, opacity / denominator


def relocate_dead(optimizer: SplatOptimizer, generator: torch.Generator) -> int:
    """Move every dead splat onto a live one; returns how many were moved."""
    gaussians = optimizer.gaussians.detach()
    opacities = gaussians.opacities
    dead = (opacities <= _DEAD).nonzero()[:, 0]
    alive = (opacities > _DEAD).nonzero()[:, 0]
    if len(dead) == 0 or len(alive) == 0:
        return 0
    chosen = alive[_draw(opacities[alive], len(dead), generator)]
    shared = _shared(gaussians, chosen)
    optimizer.overwrite(chosen, shared)
    optimizer.overwrite(dead, shared)
    return len(dead)


def grow(optimizer: SplatOptimizer, budget: int, generator: torch.Generator) -> int:
    """Five percent more splats, up to the budget, on top of live ones; returns how many were added."""
    count = len(optimizer)
    more = min(budget, int(_GROWTH * count)) - count
    if more <= 0:
        return 0
    gaussians = optimizer.gaussians.detach()
    chosen = _draw(gaussians.opacities, more, generator)
    shared = _shared(gaussians, chosen)
    optimizer.overwrite(chosen, shared)
    optimizer.append(shared)
    return more


def add_noise(optimizer: SplatOptimizer, strength: float, generator: torch.Generator) -> None:
    """Noise with each splat's own covariance on the position, only where it is nearly transparent (equation 8)."""
    gaussians = optimizer.gaussians.detach()
    share = torch.sigmoid(-_NOISE_SHARPNESS * (gaussians.opacities - _NOISE_OPACITY))
    draws = torch.randn(gaussians.means.shape, generator=generator).to(gaussians.device)
    quats = gaussians.unit_quats
    inverse = quats * quats.new_tensor([1, -1, -1, -1])
    noise = rotate_vectors(quats, rotate_vectors(inverse, draws) * gaussians.scales**2)
    optimizer.shift_means(noise * (share * strength * _NOISE_RATE * optimizer.means_rate)[:, None])


def _draw(opacities: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """`count` indices with replacement, in proportion to opacity."""
    # cumulative sums rather than multinomial, which takes at most 2^24 categories
    edges = opacities.double().cumsum(0).cpu()
    draws = torch.rand(count, generator=generator, dtype=torch.float64) * edges[-1]
    return torch.searchsorted(edges, draws).clamp(max=len(edges) - 1).to(opacities.device)


def _shared(gaussians: Gaussians, chosen: Tensor) -> Gaussians:
    copies = (torch.bincount(chosen, minlength=len(gaussians))[chosen] + 1).clamp(max=_MOST_COPIES)
    picked = gaussians[chosen]
    opacity, factor = shared_opacity_and_scale(picked.opacities, copies)
    opacity = opacity.clamp(_DEAD, 1 - 1e-6)
    log_scales = picked.log_scales + factor.log()[:, None]
    return Gaussians(picked.means, picked.quats, log_scales, torch.logit(opacity), picked.sh)
