"""The photometric loss on an NVIDIA GPU: four kernels of Triton for its value and gradient instead of about forty of
PyTorch, and no wait for the GPU.

Triton compiles the kernels when they are first used. It is imported only then.
"""

from __future__ import annotations

import functools
import importlib
import math
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from studio.metrics import ssim_taps

WARPS = 4  # warps of a program


@functools.cache
def _taps(device: torch.device) -> Tensor:
    return torch.tensor(ssim_taps(), dtype=torch.float32, device=device)


class _Fused(torch.autograd.Function):
    """The loss and, where it is needed, its gradient with respect to the image."""

    @staticmethod
    def forward(ctx: Any, image: Tensor, target: Tensor, weight: float) -> Tensor:
        kernels = importlib.import_module("studio.training.triton.loss_kernels")
        image, target = image.detach().contiguous(), target.contiguous()
        height, width, _ = image.shape
        count = image.numel()
        taps = _taps(image.device)
        moments, derivatives = image.new_empty((5, *image.shape)), image.new_empty((3, *image.shape))
        programs = (math.ceil(count / kernels.BLOCK),)
        sums = image.new_empty((*programs, 2))
        with torch.cuda.device_of(image):
            kernels.blur_rows_of_moments[programs](image, target, taps, moments, width, count, num_warps=WARPS)
            kernels.compare[programs](
                image, target, taps, moments, derivatives, sums, width, height, count, num_warps=WARPS
            )
            ctx.gradient = None
            if ctx.needs_input_grad[0]:
                blurred, ctx.gradient = moments[:3], torch.empty_like(image)  # the moments are no longer needed
                kernels.blur_rows[programs](derivatives, taps, blurred, width, count, num_warps=WARPS)
                kernels.combine[programs](
                    image, target, taps, blurred, ctx.gradient, width, height, count, (1 - weight) / count,
                    -weight / count, num_warps=WARPS,
                )  # fmt: skip
        l1, similarity = (sums.sum(0, dtype=torch.float64) / count).unbind()
        return ((1 - weight) * l1 + weight * (1 - similarity)).to(image.dtype)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, None, None]:
        return None if ctx.gradient is None else ctx.gradient * upstream, None, None


def photometric_loss_triton(image: Tensor, target: Tensor, dssim_weight: float) -> Tensor:
    """`studio.training.photometric.photometric_loss` for float32 on an NVIDIA GPU, or with Triton's interpreter."""
    loss: Tensor = _Fused.apply(image, target.detach(), dssim_weight)
    return loss
