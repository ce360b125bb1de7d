"""Dropout of splats: each step draws a random subset, with raised opacities."""

import math
from typing import Any

import torch
from torch import Tensor

from studio.rasterizer.cpu import kernel_threads
from studio.rasterizer.kernels import kernels_for
from studio.training.noise import random_bits

DROPPED_LOGIT = -30.0  # logit of a dropped splat: far below the opacity from which the rasterizer draws a splat, 1/255
_LEAST_OPACITY, _MOST_OPACITY = 1e-6, 0.995


class _Fused(torch.autograd.Function):
    """The kernel computes the derivative along with the value."""

    @staticmethod
    def forward(ctx: Any, logits: Tensor, share: float, seed: int, kernels: Any) -> Tensor:
        data = logits.detach().contiguous()
        drawn, derivative = torch.empty_like(data), torch.empty_like(data)
        kernels.dropout(data, share, seed, drawn, derivative, kernel_threads())
        ctx.save_for_backward(derivative)
        return drawn

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor) -> tuple[Tensor, None, None, None]:
        return upstream[0] * ctx.saved_tensors[0], None, None, None


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
    if kernels is not None:
        return _Fused.apply(logits, share, seed, kernels)  # type: ignore[no-untyped-call,no-any-return]
    return drop_splats_torch(logits, share, seed)


def drop_splats_torch(logits: Tensor, share: float, seed: int) -> Tensor:
    """`drop_splats` in plain PyTorch, for any device and dtype. This is the definition."""
    dropped = random_bits(len(logits), seed, logits.device) < math.floor(share * 2**24)
    drawn = torch.logit((logits.sigmoid() / (1 - share)).clamp(_LEAST_OPACITY, _MOST_OPACITY))
    return torch.where(dropped, DROPPED_LOGIT, drawn)
