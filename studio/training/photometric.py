"""The photometric loss of 3DGS: (1 - w) L1 + w (1 - SSIM)."""

from __future__ import annotations

from torch import Tensor

from studio.metrics import ssim


def photometric_loss(image: Tensor, target: Tensor, dssim_weight: float = 0.2) -> Tensor:
    """How far a drawn image is from the footage (Kerbl et al. 2023, equation 7; SSIM as in `studio.metrics`).

    Args:
        image: (H, W, 3), the drawing; the gradient goes here.
        target: (H, W, 3) in 0 to 1, same dtype and device.
        dssim_weight: w, 0 to 1.

    Returns:
        Scalar.

    Raises:
        StudioError: the shapes do not fit.
    """
    l1 = (image - target).abs().mean()
    return (1 - dssim_weight) * l1 + dssim_weight * (1 - ssim(image, target))
