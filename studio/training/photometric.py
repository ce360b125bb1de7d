"""The photometric loss of 3DGS, (1 - w) L1 + w (1 - SSIM): for float32, a fused C++ kernel on the CPU and fused Triton
kernels on an NVIDIA GPU; else PyTorch."""

from typing import Any

import torch
from torch import Tensor

from v3studio.studio.errors import StudioError
from v3studio.studio.metrics import check_image_pair, ssim
from v3studio.studio.rasterizer.cpu import kernel_threads
from v3studio.studio.rasterizer.kernels import kernels_for, uses_triton
from v3studio.studio.training.known_gradients import with_gradients


def _fused(kernels: Any, image: Tensor, target: Tensor, weight: float) -> Tensor:
    """The loss and its gradient with respect to the image, computed in one pass."""
    data = image.detach().contiguous()
    gradient = torch.empty_like(data) if image.requires_grad else None
    height, width, _ = image.shape
    l1, similarity = kernels.loss(data, target.detach().contiguous(), width, height, weight, gradient, kernel_threads())
    return with_gradients(data.new_tensor((1 - weight) * l1 + weight * (1 - similarity)), [image], [gradient])


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
    kernels = kernels_for(image, target)
    if kernels is not None and image.dtype == torch.float32:
        return _fused(kernels, image, target, float(dssim_weight))
    if image.device == target.device and uses_triton(image) and uses_triton(target):
        from v3studio.studio.training.triton.loss import photometric_loss_triton

        return photometric_loss_triton(image, target, float(dssim_weight))
    return photometric_loss_torch(image, target, dssim_weight)
