"""Images of what splats have besides colors: normals, motion, numbers of parts."""

from dataclasses import replace

import torch
from torch import Tensor

from studio.cameras import Camera
from studio.gaussians import SH_C0, Gaussians
from studio.rasterizer.interface import rasterize
from studio.rasterizer.types import mean_depth


@torch.no_grad()
def mean_features(gaussians: Gaussians, camera: Camera, features: Tensor) -> Tensor:
    """(H, W, 3) float32: features (N, 3) of the splats that a pixel shows, by blending weight; 0 for none."""
    if not len(gaussians):
        return torch.zeros(camera.height, camera.width, 3)
    low = features.amin(0)
    extent = (features.amax(0) - low).clamp_min(1e-12)
    # the rasterizer blends colors: 0.5 + SH_C0 * sh, not below 0
    colors = ((features - low) / extent - 0.5) / SH_C0
    rendered = rasterize(replace(gaussians, sh=colors[:, None].to(gaussians.means)), camera)
    shares = torch.stack([mean_depth(one, rendered.alpha) for one in rendered.image.unbind(-1)], -1)
    return torch.where(rendered.alpha[..., None] > 0, low + extent * shares, 0.0)
