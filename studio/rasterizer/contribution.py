"""What each splat adds to a picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from studio.cameras import Camera
from studio.gaussians import Gaussians
from studio.rasterizer.interface import rasterize

_Y0 = 0.28209479177387814  # the constant spherical harmonic


def contribution(gaussians: Gaussians, camera: Camera) -> np.ndarray:
    """Sum over the pixels of each splat's blending weight alpha_i prod_(j<i) (1 - alpha_j) (3DGS, equation 3).

    The weights are the derivative of the picture by the splats' colors, so that one backward pass gives them all.

    Args:
        gaussians: N splats, on the device to render on.
        camera: to look from, without distortion.

    Returns:
        (N,) float64, at least 0; 0 for splats that the camera does not see.
    """
    gray = torch.zeros(len(gaussians), 1, 3, device=gaussians.device, dtype=gaussians.means.dtype, requires_grad=True)
    rendered = rasterize(replace(gaussians.detach(), sh=gray), camera)
    rendered.image[..., 0].sum().backward()
    assert gray.grad is not None
    weights: np.ndarray = gray.grad[:, 0, 0].double().cpu().numpy() / _Y0
    return np.maximum(weights, 0)
