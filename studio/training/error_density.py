"""The densification strategy `error`: splats move from where they hardly contribute to where the pictures are wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from studio.gaussians import Gaussians
from studio.torch_rotations import rotate_vectors
from studio.training.attribution import Shares
from studio.training.relocate import shared_opacity_and_scale
from studio.training.settings import TrainSettings
from studio.training.splat_optimizer import SplatOptimizer

_GROWTH = 1.05
"""Maximum growth factor per densification."""
_OFFSET = 0.5
"""Distance of either half from the mean of the split splat, in standard deviations along its longest axis."""
_NARROWER = 0.87
"""Factor of the longest axis: with both halves apart, the variance along it stays the same (sqrt(1 - 0.5^2))."""


class ErrorDensity:
    """Removes the splats that contribute least and splits those that account for most of the error.

    Args:
        settings: uses `densify_from`, `densify_until`, `densify_every`, `densify_max_splats` and `relocate_ratio`.
        shares: what each splat accounts for, of the current splats.
    """

    wants_screen_gradients = False

    def __init__(self, settings: TrainSettings, shares: Callable[[Gaussians], Shares]) -> None:
        self._settings, self._shares = settings, shares

    def observe(self, *_: object) -> None:
        """Does nothing: errors are measured when they are needed."""

    def after_step(self, iteration: int, optimizer: SplatOptimizer, generator: torch.Generator) -> None:
        """Move and add splats if due; `iteration` counts from 1."""
        settings = self._settings
        if settings.densify_from < iteration < settings.densify_until and iteration % settings.densify_every == 0:
            move_to_errors(
                optimizer,
                self._shares(optimizer.gaussians.detach()),
                settings.relocate_ratio,
                settings.densify_max_splats,
            )

    def state(self) -> dict[str, Tensor]:
        """Empty: this strategy has no state."""
        return {}

    def restore(self, state: dict[str, Tensor]) -> None:
        """Does nothing."""


@torch.no_grad()
def move_to_errors(optimizer: SplatOptimizer, found: Shares, ratio: float, budget: int) -> None:
    """Remove the fraction `ratio` of the splats, lowest weight first, and split as many with the largest errors.

    Until there are `budget` splats, up to 5% more are split. Above it, splats are removed without replacement.
    """
    count = len(optimizer)
    removed = max(int(count * ratio), count - budget)
    kept = torch.argsort(found.weight, stable=True)[removed:].sort().values
    wanted = min(budget, int(_GROWTH * count)) - len(kept)
    error = found.error[kept]
    optimizer.keep(kept)
    split = torch.argsort(error, descending=True, stable=True)[: max(0, wanted)]
    split = split[error[split] > 0]
    if not len(split):
        return
    first, second = halves(optimizer.gaussians.detach()[split])
    optimizer.overwrite(split, first)
    optimizer.append(second)


def halves(gaussians: Gaussians) -> tuple[Gaussians, Gaussians]:
    """Two splats in place of each: apart along its longest axis, and together they cover as much as it did."""
    axis = torch.nn.functional.one_hot(gaussians.log_scales.argmax(-1), 3).to(gaussians.means)
    offset = rotate_vectors(gaussians.unit_quats, axis * gaussians.scales * _OFFSET)
    opacities = gaussians.opacities
    opacity, factor = shared_opacity_and_scale(opacities, torch.full_like(opacities, 2, dtype=torch.long))
    logits = torch.logit((opacity / _NARROWER).clamp(1e-4, 0.99))
    log_scales = gaussians.log_scales + axis * math.log(_NARROWER) + factor.log()[:, None]

    def moved(sign: float) -> Gaussians:
        means = gaussians.means + sign * offset
        return replace(gaussians, means=means, log_scales=log_scales, logit_opacities=logits)

    return moved(1.0), moved(-1.0)
