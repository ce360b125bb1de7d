"""The loss on coded values on an NVIDIA GPU: one kernel of Triton instead of about sixty of PyTorch, and no wait.

Triton compiles the kernel when it is first used. It is imported only then.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

WARPS = 4  # warps of a program


class _Fused(torch.autograd.Function):
    """The weighted loss with its gradients, and the bits per splat, which have none."""

    @staticmethod
    def forward(ctx: Any, owner: Any, seed: int, now: Tensor, mu: Tensor, log_sigma: Tensor) -> tuple[Tensor, Tensor]:
        kernels = importlib.import_module("studio.training.triton.coded_kernels")
        count, channels = now.shape
        blocks = math.ceil(count / kernels.BLOCK)
        gradient, sums = (
            torch.empty_like(now, memory_format=torch.contiguous_format),
            now.new_empty((blocks, channels, 4)),
        )
        bits_weight, difference_weight = owner.entropy_weight / count, owner.temporal_weight / owner.pixels
        with torch.cuda.device_of(now):
            kernels.coded_loss[(blocks, channels)](
                now.detach().contiguous(), owner.before, owner.steps, owner.attribute_of_channel, mu.detach(),
                log_sigma.detach(), gradient, sums, count, channels, seed, bits_weight, difference_weight,
                num_warps=WARPS,
            )  # fmt: skip
        totals = sums.sum(0, dtype=torch.float64)  # (C, 4)
        # a product instead of index_add, whose order on a GPU, and so whose bits, would change
        by_attribute = owner.channels_of_attribute @ totals[:, 2:] * bits_weight
        ctx.save_for_backward(
            gradient, by_attribute[:, 0].to(mu.dtype), by_attribute[:, 1].to(mu.dtype) * log_sigma.detach().exp()
        )
        bits, difference = totals[:, :2].sum(0).unbind()
        per_splat = (bits / count if owner.entropy_weight else bits * 0).to(now.dtype)
        ctx.mark_non_differentiable(per_splat)
        return (bits_weight * bits + difference_weight * difference).to(now.dtype), per_splat

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        return None, None, *(one * upstream[0] for one in ctx.saved_tensors)


def coded_loss_triton(owner: Any, mu: Tensor, log_sigma: Tensor, now: Tensor, seed: int) -> tuple[Tensor, Tensor]:
    """`CodedLoss.forward` for float32 on an NVIDIA GPU; with Triton's interpreter, on the CPU.

    Args:
        owner: the `CodedLoss`, whose module imports this one.
        mu, log_sigma: (attributes,) its learned distributions.
        now, seed: as for `CodedLoss.forward`.
    """
    return _Fused.apply(owner, seed, now, mu, log_sigma)  # type: ignore[no-untyped-call,no-any-return]
