"""Measures how much each splat contributes to images."""

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import SH_C0, Gaussians
from v3studio.studio.rasterizer.interface import rasterize


@torch.enable_grad()  # type: ignore[untyped-decorator]
def contribution(gaussians: Gaussians, cameras: Sequence[Camera], weights: Sequence[Tensor] | None = None) -> Tensor:
    """(N,) float64 sum over cameras, without distortion, and pixels of each splat's blending weight alpha_i prod_(j<i)
    (1 - alpha_j) (3DGS, equation 3); at least 0. `weights`, (H, W): how much pixels of each camera count; None: the
    same.

    The weights are the derivative of the image by the splats' colors, so one backward pass per camera gives them all.
    """
    gray = torch.zeros(len(gaussians), 1, 3, device=gaussians.device, dtype=gaussians.means.dtype, requires_grad=True)
    colorless = replace(gaussians.detach(), sh=gray)
    for number, camera in enumerate(cameras):
        seen = rasterize(colorless, camera).image[..., 0]
        # A sum: for the gradient of an image, PyTorch would import SymPy, which takes seconds.
        (seen if weights is None else seen * weights[number]).sum().backward()  # type: ignore[no-untyped-call]
    assert gray.grad is not None
    return gray.grad[:, 0, 0].double().clamp_min(0) / SH_C0
