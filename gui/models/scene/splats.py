"""Renders Gaussians to the pixels that the viewport shows."""

import numpy as np
import torch

from gui.models.scene.compose import SplatLayer
from studio.cameras import Camera
from studio.gaussians import Gaussians
from studio.rasterizer import preferred_device, rasterize


def draw(gaussians: Gaussians, camera: Camera, background: tuple[float, float, float]) -> np.ndarray:
    """Render on the GPU if there is one: (height, width, 3) uint8 RGB, C order. Raises StudioError, see `rasterize`."""
    device = preferred_device()
    with torch.no_grad():
        moved = gaussians.to(device)
        color = torch.tensor(background, dtype=moved.means.dtype, device=device)
        image = rasterize(moved, camera, color).image
        pixels = image.clamp_(0.0, 1.0).mul_(255.0).add_(0.5).to(torch.uint8)  # in place: it has no other references
    return np.ascontiguousarray(pixels.cpu().numpy())


def draw_layer(gaussians: Gaussians, camera: Camera) -> SplatLayer:
    """Render over black, with opacity and depth, on the GPU if there is one. Raises StudioError, see `rasterize`."""
    device = preferred_device()
    with torch.no_grad():
        moved = gaussians.to(device)
        render = rasterize(moved, camera, torch.zeros(3, dtype=moved.means.dtype, device=device))
    image, alpha, depth = (one.float().cpu().numpy() for one in (render.image, render.alpha, render.depth))
    return SplatLayer(image, alpha, depth)
