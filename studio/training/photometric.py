"""The photometric loss of 3DGS, (1 - w) L1 + w (1 - SSIM): for float32, a fused C++ kernel on the CPU and fused Triton
kernels on an NVIDIA GPU; else PyTorch."""

from typing import Any

import torch
from torch import Tensor

from studio.errors import StudioError
from studio.metrics import check_image_pair, ssim
from studio.rasterizer import available_backends
from studio.rasterizer.cpu import kernel_threads, load_kernels
from studio.training.triton.loss import photometric_loss_triton


class _Fused(torch.autograd.Function):
    """The loss and its gradient with respect to the image, computed in one pass."""

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
    """`photometric_loss` in plain PyTorch, for any device and dtype. This is the definition of the loss."""
    l1 = (image - target).abs().mean()
    return (1 - dssim_weight) * l1 + dssim_weight * (1 - ssim(image, target))


def photometric_loss(image: Tensor, target: Tensor, dssim_weight: float = 0.2) -> Tensor:
    """(1 - w) L1 + w (1 - SSIM), a scalar (Kerbl et al. 2023, equation 7; SSIM as in `studio.metrics`).

    Args:
        image: (H, W, 3) rendered image; the only argument that gets a gradient.
        target: (H, W, 3) in 0 to 1, same dtype and device.

    Raises:
        StudioError: `metrics.image_shape`, or `settings.invalid_value` for a weight outside 0 to 1.
    """
    check_image_pair(image, target)
    if not 0 <= dssim_weight <= 1:
        problem = f"dssim_weight is {dssim_weight}; it must be between 0 and 1"
        raise StudioError("settings.invalid_value", problem, value=dssim_weight, setting="train.dssim_weight")
    if image.device == target.device and image.dtype == target.dtype == torch.float32:
        if image.device.type == "cpu" and "cpu" in available_backends():
            return _Fused.apply(image, target, float(dssim_weight))
        if image.device.type == "cuda" and "triton" in available_backends():
            return photometric_loss_triton(image, target, float(dssim_weight))
    return photometric_loss_torch(image, target, dssim_weight)
