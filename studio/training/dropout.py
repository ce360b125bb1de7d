"""Leaving splats out at random while training (DropGaussian, Park et al. 2025, equation 6).

With few cameras splats learn to be right together only in the training views: one hides the other's error. Leaving a
random share of them out at each step makes each right by itself, which shows in views that were never trained on.
"""

from __future__ import annotations

import torch
from torch import Tensor

from studio.gaussians import Gaussians

_MAX_OPACITY = 0.995


def dropped(gaussians: Gaussians, share: float, generator: torch.Generator) -> tuple[Gaussians, Tensor]:
    """A random 1 - `share` of the splats, their opacities divided by 1 - `share` so that the picture stays as dense.

    Args:
        gaussians: N splats.
        share: above 0 and below 1.
        generator: draws which ones.

    Returns:
        The M splats that are left, and their (M,) indices.
    """
    kept = (torch.rand(len(gaussians), generator=generator) >= share).nonzero()[:, 0].to(gaussians.device)
    left = gaussians[kept]
    opacities = (left.opacities / (1 - share)).clamp(1e-6, _MAX_OPACITY)
    return Gaussians(left.means, left.quats, left.log_scales, torch.logit(opacities), left.sh), kept
