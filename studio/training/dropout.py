"""Leaving splats out at random while training (DropGaussian, Park et al. 2025, equation 6).

With few cameras splats learn to be right together only in the training views: one hides the other's error. Leaving a
random share of them out at each step makes each right by itself, which shows in views that were never trained on.
"""

from __future__ import annotations

import torch

from studio.gaussians import Gaussians

_MAX_OPACITY = 0.995


def dropped(gaussians: Gaussians, share: float, generator: torch.Generator) -> Gaussians:
    """A random 1 - `share` of the splats, their opacities divided by 1 - `share` so that the picture stays as dense.

    Args:
        gaussians: N splats.
        share: 0 to below 1; 0 gives the splats back as they are.
        generator: draws which ones.
    """
    if share == 0:
        return gaussians
    keep = (torch.rand(len(gaussians), generator=generator) >= share).to(gaussians.device)
    left = gaussians[keep]
    opacities = (left.opacities / (1 - share)).clamp(1e-6, _MAX_OPACITY)
    return Gaussians(left.means, left.quats, left.log_scales, torch.logit(opacities), left.sh)
