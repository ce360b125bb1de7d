"""The image quality metrics PSNR and SSIM: one definition for training, evaluation and reports."""

import functools
import math

import torch
import torch.nn.functional as F
from torch import Tensor

from v3studio.studio.errors import StudioError

SSIM_WINDOW = 11  # size of the Gaussian window of SSIM in pixels
SSIM_SIGMA = 1.5  # standard deviation of the Gaussian window of SSIM in pixels
SSIM_C1, SSIM_C2 = 0.01**2, 0.03**2  # stabilizing constants of SSIM for values in 0 to 1


def check_image_pair(image: Tensor, target: Tensor) -> None:
    """StudioError (`metrics.image_shape`) unless both are non-empty (H, W, 3) tensors of the same size."""
    if image.shape != target.shape or image.ndim != 3 or image.shape[-1] != 3 or image.numel() == 0:
        shapes = (tuple(image.shape), tuple(target.shape))
        problem = f"the images have shapes {shapes[0]} and {shapes[1]}; expected (H, W, 3) and the same size for both"
        raise StudioError("metrics.image_shape", problem, value=shapes)


def psnr(image: Tensor, target: Tensor, mask: Tensor | None = None) -> Tensor:
    """Peak signal-to-noise ratio in dB of (H, W, 3) images in 0 to 1, infinity for identical ones. `mask`: (H, W)
    weights, 0 to 1; None: equal. StudioError `metrics.image_shape`, `metrics.mask_shape` or `metrics.mask_empty`."""
    check_image_pair(image, target)
    squared = (image - target).square().mean(-1)
    if mask is None:
        return -10.0 * torch.log10(squared.mean())
    if mask.shape != squared.shape:
        mask_shape, size = tuple(mask.shape), tuple(squared.shape)
        problem = f"the mask has shape {mask_shape}; expected {size}"
        raise StudioError("metrics.mask_shape", problem, value=mask_shape, expected=size)
    if not mask.sum() > 0:
        raise StudioError("metrics.mask_empty", "the mask is empty")
    weights = mask.to(squared)
    return -10.0 * torch.log10((squared * weights).sum() / weights.sum())


@functools.cache
def ssim_taps() -> tuple[float, ...]:
    """The `SSIM_WINDOW` weights of SSIM's Gaussian window in one direction, sum 1."""
    values = [math.exp(-((i - SSIM_WINDOW // 2) ** 2) / (2 * SSIM_SIGMA**2)) for i in range(SSIM_WINDOW)]
    return tuple(value / sum(values) for value in values)


def gaussian_blur(planes: Tensor) -> Tensor:
    """Blur (C, H, W) planes with the window of SSIM, zero padding; same size."""
    taps = planes.new_tensor(ssim_taps())
    channels = planes.shape[0]
    row = taps.view(1, 1, 1, -1).expand(channels, 1, 1, -1)
    column = taps.view(1, 1, -1, 1).expand(channels, 1, -1, 1)
    half = SSIM_WINDOW // 2
    blurred = F.conv2d(planes[None], row, padding=(0, half), groups=channels)
    return F.conv2d(blurred, column, padding=(half, 0), groups=channels)[0]


def ssim_map(image: Tensor, target: Tensor) -> Tensor:
    """(3, H, W) SSIM per channel and pixel; see `ssim`."""
    check_image_pair(image, target)
    x, y = image.permute(2, 0, 1), target.permute(2, 0, 1)
    mean_x, mean_y, xx, yy, xy = gaussian_blur(torch.cat([x, y, x * x, y * y, x * y])).chunk(5)
    var_x, var_y, cov = xx - mean_x.square(), yy - mean_y.square(), xy - mean_x * mean_y
    top = (2 * mean_x * mean_y + SSIM_C1) * (2 * cov + SSIM_C2)
    bottom = (mean_x.square() + mean_y.square() + SSIM_C1) * (var_x + var_y + SSIM_C2)
    return top / bottom


def ssim(image: Tensor, target: Tensor) -> Tensor:
    """Structural similarity (Wang et al. 2004) with an 11x11 Gaussian window, sigma 1.5, as in 3DGS and VideoGS, of (H,
    W, 3) images in 0 to 1; at most 1, differentiable.

    The image is zero-padded, and channels are compared separately. StudioError: `metrics.image_shape`.
    """
    return ssim_map(image, target).mean(0).mean()
