"""Dropout of splats: each step draws a random subset, with raised opacities."""

import math

import torch
from torch import Tensor

from v3studio.studio.rasterizer.cpu import kernel_threads
from v3studio.studio.rasterizer.kernels import kernels_for
from v3studio.studio.training.known_gradients import with_gradients
from v3studio.studio.training.noise import random_bits

DROPPED_LOGIT = -30.0  # logit of a dropped splat: far below the opacity from which the rasterizer draws a splat, 1/255
_LEAST_OPACITY, _MOST_OPACITY = 1e-6, 0.995


def drop_splats(logits: Tensor, share: float, seed: int) -> Tensor:
    """Drop a random fraction of the splats; the opacities of the others are divided by 1 - `share` to compensate.

    With few cameras, splats overfit jointly: one hides the error of another in the training views. Dropping a random
    subset in each step reduces this and improves held-out views (DropGaussian, Park et al. 2025, equation 6).

    Args:
        logits: (N,) opacities of the splats, as logits.
        share: fraction to drop, 0 to below 1.
        seed: selects the dropped splats, 0 to 2^32 - 1.

    Returns:
        (N,) logits to draw; those of dropped splats are `DROPPED_LOGIT` and have no gradient.
    """
    kernels = kernels_for(logits)
    if kernels is None:
        return drop_splats_torch(logits, share, seed)
    data = logits.detach().contiguous()
    drawn, derivative = torch.empty_like(data), torch.empty_like(data)
    kernels.dropout(data, share, seed, drawn, derivative, kernel_threads())
    return with_gradients(drawn, [logits], [derivative])


def drop_splats_torch(logits: Tensor, share: float, seed: int) -> Tensor:
    """`drop_splats` in plain PyTorch, for any device and dtype. This is the definition."""
    dropped = random_bits(len(logits), seed, logits.device) < math.floor(share * 2**24)
    drawn = torch.logit((logits.sigmoid() / (1 - share)).clamp(_LEAST_OPACITY, _MOST_OPACITY))
    return torch.where(dropped, DROPPED_LOGIT, drawn)
