"""The photometric loss of 3DGS: (1 - w) L1 + w (1 - SSIM), in one pass in C++ for float32 on the CPU, else in torch."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from studio.errors import StudioError
from studio.metrics import ssim
from studio.rasterizer import available_backends
from studio.rasterizer.cpu import kernel_threads, load_kernels


class _Fused(torch.autograd.Function):
    """The loss and, in the same sweep, its gradient with respect to the image."""

    @staticmethod
    def forward(ctx: Any, image: Tensor, target: Tensor, weight: float) -> Tensor:
        image_data, target_data = image.detach().contiguous(), target.detach().contiguous()
        gradient = torch.empty_like(image_data) if ctx.needs_input_grad[0] else None
        height, width, _ = image.shape
        l1, similarity = load_kernels().loss(image_data, target_data, width, height, weight, gradient, kernel_threads())
        ctx.gradient = gradient
        return image.new_tensor((1 - weight) * l1 + weight * (1 - similarity))

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, None, None]:
        factor = float(upstream)
        gradient = ctx.gradient
        return gradient if gradient is None or factor == 1.0 else gradient * factor, None, None


def photometric_loss_torch(image: Tensor, target: Tensor, dssim_weight: float = 0.2) -> Tensor:
    """As `photometric_loss`, in plain torch for any device and dtype: the definition."""
    l1 = (image - target).abs().mean()
    return (1 - dssim_weight) * l1 + dssim_weight * (1 - ssim(image, target))


def photometric_loss(image: Tensor, target: Tensor, dssim_weight: float = 0.2) -> Tensor:
    """How far a drawn image is from the footage (Kerbl et al. 2023, equation 7; SSIM as in `studio.metrics`).

    Args:
        image: (H, W, 3), the drawing; the gradient goes here and nowhere else.
        target: (H, W, 3) in 0 to 1, same dtype and device.
        dssim_weight: w, 0 to 1.

    Returns:
        Scalar.

    Raises:
        StudioError: the shapes do not fit or the weight is not from 0 to 1.
    """
    if image.shape != target.shape or image.ndim != 3 or image.shape[-1] != 3 or image.numel() == 0:
        raise StudioError(
            f"Two (H, W, 3) images of one size are needed, found {tuple(image.shape)} and {tuple(target.shape)}."
        )
    if not 0 <= dssim_weight <= 1:
        raise StudioError(f"dssim_weight must be from 0 to 1, found {dssim_weight}.")
    on_cpu = image.device.type == "cpu" and target.device.type == "cpu"
    if on_cpu and image.dtype == target.dtype == torch.float32 and "cpu" in available_backends():
        return _Fused.apply(image, target, float(dssim_weight))
    return photometric_loss_torch(image, target, dssim_weight)
