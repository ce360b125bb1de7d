"""Image quality: PSNR and SSIM, one definition for training, evaluation and reports."""

from __future__ import annotations

import functools
import math

import torch
import torch.nn.functional as F
from torch import Tensor

from studio.errors import StudioError

SSIM_WINDOW = 11
"""Side of SSIM's Gaussian window, pixels."""

SSIM_SIGMA = 1.5
"""Standard deviation of SSIM's Gaussian window, pixels."""

SSIM_C1, SSIM_C2 = 0.01**2, 0.03**2
"""SSIM's stabilizing constants for values in 0 to 1."""


def _check(image: Tensor, target: Tensor) -> None:
    if image.shape != target.shape or image.ndim != 3 or image.shape[-1] != 3 or image.numel() == 0:
        raise StudioError(
            f"Two (H, W, 3) images of one size are needed, found {tuple(image.shape)} and {tuple(target.shape)}."
        )


def psnr(image: Tensor, target: Tensor, mask: Tensor | None = None) -> Tensor:
    """Peak signal-to-noise ratio in dB, peak 1.

    Args:
        image, target: (H, W, 3) in 0 to 1.
        mask: (H, W) weights of the pixels, 0 to 1, or None for all alike.

    Returns:
        Scalar; infinity for images without a difference.

    Raises:
        StudioError: the shapes do not fit, or the mask is empty.
    """
    _check(image, target)
    squared = (image - target).square().mean(-1)
    if mask is None:
        mean = squared.mean()
    else:
        if mask.shape != squared.shape:
            raise StudioError(f"The mask must be {tuple(squared.shape)}, found {tuple(mask.shape)}.")
        weights = mask.to(squared)
        total = weights.sum()
        if not total > 0:
            raise StudioError("The mask for PSNR is empty.")
        mean = (squared * weights).sum() / total
    return -10.0 * torch.log10(mean)


@functools.cache
def _taps() -> tuple[float, ...]:
    values = [math.exp(-((i - SSIM_WINDOW // 2) ** 2) / (2 * SSIM_SIGMA**2)) for i in range(SSIM_WINDOW)]
    return tuple(value / sum(values) for value in values)


def gaussian_blur(planes: Tensor) -> Tensor:
    """SSIM's window over (C, H, W) planes, zeros outside the image, same size."""
    taps = planes.new_tensor(_taps())
    channels = planes.shape[0]
    row = taps.view(1, 1, 1, -1).expand(channels, 1, 1, -1)
    column = taps.view(1, 1, -1, 1).expand(channels, 1, -1, 1)
    half = SSIM_WINDOW // 2
    blurred = F.conv2d(planes[None], row, padding=(0, half), groups=channels)
    return F.conv2d(blurred, column, padding=(half, 0), groups=channels)[0]


def ssim_map(image: Tensor, target: Tensor) -> Tensor:
    """SSIM at each pixel and channel, (3, H, W); see `ssim`."""
    _check(image, target)
    x, y = image.permute(2, 0, 1), target.permute(2, 0, 1)
    mean_x, mean_y, xx, yy, xy = gaussian_blur(torch.cat([x, y, x * x, y * y, x * y])).chunk(5)
    var_x, var_y, cov = xx - mean_x.square(), yy - mean_y.square(), xy - mean_x * mean_y
    top = (2 * mean_x * mean_y + SSIM_C1) * (2 * cov + SSIM_C2)
    bottom = (mean_x.square() + mean_y.square() + SSIM_C1) * (var_x + var_y + SSIM_C2)
    return top / bottom


def ssim(image: Tensor, target: Tensor, mask: Tensor | None = None) -> Tensor:
    """Structural similarity (Wang et al. 2004): 11x11 Gaussian window, sigma 1.5, as 3DGS and VideoGS measure it.

    The window is zero-padded at the image's border, each channel is compared for itself, and the map is averaged.

    Args:
        image, target: (H, W, 3) in 0 to 1.
        mask: (H, W) weights of the map's pixels in the mean, or None for all alike.

    Returns:
        Scalar, at most 1. Differentiable.

    Raises:
        StudioError: the shapes do not fit, or the mask is empty.
    """
    values = ssim_map(image, target).mean(0)
    if mask is None:
        return values.mean()
    if mask.shape != values.shape:
        raise StudioError(f"The mask must be {tuple(values.shape)}, found {tuple(mask.shape)}.")
    weights = mask.to(values)
    if not weights.sum() > 0:
        raise StudioError("The mask for SSIM is empty.")
    return (values * weights).sum() / weights.sum()
