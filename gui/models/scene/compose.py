"""Renders splats, alone or composed with opaque surfaces, lines and points by depth.

The splats come from the rasterizer with their opacity and depth, so that what is behind them shines through where they
are transparent, as it would if everything were rendered together.
"""

from dataclasses import dataclass

import numpy as np
import torch

from v3studio.gui.models.scene.contents import Color
from v3studio.gui.models.scene.fragments import Patch
from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import Render, preferred_device, rasterize

MOST_PER_PIXEL = 8  # fragments that are blended in a pixel: the nearest ones
SLACK = 1.002  # relative depth by which lines may lie behind a surface and still be drawn: edges of a surface lie on it
FAINT = 0.02  # opacity of splats below which their depth does not count


@dataclass(frozen=True, eq=False)
class SplatLayer:
    """Rendered splats: (H, W, 3) float32 RGB over black, opacity, and depth along the axis in world units."""

    image: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray

    def over(self, behind: np.ndarray) -> np.ndarray:
        """The splats over an image, (H, W, 3) float32 RGB in 0 to 1; may exceed 1."""
        return self.image + (1 - self.alpha[..., None]) * behind


def draw(gaussians: Gaussians, camera: Camera, background: Color) -> np.ndarray:
    """Render on the GPU if there is one: (height, width, 3) uint8 RGB, C order. Raises StudioError, see `rasterize`."""
    image = _rendered(gaussians, camera, background).image
    pixels = image.clamp_(0.0, 1.0).mul_(255.0).add_(0.5).to(torch.uint8)  # in place: it has no other references
    return np.ascontiguousarray(pixels.cpu().numpy())


def draw_layer(gaussians: Gaussians, camera: Camera) -> SplatLayer:
    """Render over black, with opacity and depth, on the GPU if there is one. Raises StudioError, see `rasterize`."""
    render = _rendered(gaussians, camera, (0.0, 0.0, 0.0))
    return SplatLayer(*(tensor.float().cpu().numpy() for tensor in (render.image, render.alpha, render.depth)))


@torch.no_grad()
def _rendered(gaussians: Gaussians, camera: Camera, background: Color) -> Render:
    moved = gaussians.to(preferred_device())
    return rasterize(moved, camera, moved.means.new_tensor(background))


class Surfaces:
    """Opaque surfaces: the nearest one in each pixel, (H, W, 3) uint8, and its depth; infinite where there is none."""

    def __init__(self, width: int, height: int) -> None:
        self.pixels = np.zeros((height, width, 3), np.uint8)
        self.depth = np.full((height, width), np.inf, np.float32)

    def add(self, patch: Patch | None) -> None:
        if patch is None:
            return
        depth, pixels = self.depth[patch.rows, patch.columns], self.pixels[patch.rows, patch.columns]
        nearer = patch.where & (patch.depth < depth)
        pixels[nearer], depth[nearer] = patch.pixels[nearer], patch.depth[nearer]


def compose(background: Color, splats: SplatLayer | None, surfaces: Surfaces, fragments: np.ndarray) -> np.ndarray:
    """The image, (H, W, 3) uint8. `fragments`: (F,) `FRAGMENT` of lines and points."""
    height, width = surfaces.depth.shape
    solid_depth = surfaces.depth.reshape(-1)
    solid = surfaces.pixels.reshape(-1, 3).astype(np.float32) / 255
    splat_depth = np.full(height * width, np.inf, np.float32)
    if splats is not None:
        flat = splats.depth.reshape(-1)
        splat_depth = np.where(splats.alpha.reshape(-1) > FAINT, flat, np.inf).astype(np.float32)
    image = np.tile(np.array(background, np.float32), (height * width, 1))
    there = np.isfinite(solid_depth)
    image[there] = solid[there]
    fragments = fragments[fragments["depth"] <= solid_depth[fragments["pixel"]] * SLACK]
    behind = fragments["depth"] >= splat_depth[fragments["pixel"]]
    if splats is None:
        blend(image, fragments)
    else:
        blend(image, fragments[behind])
        image = splats.over(image.reshape(height, width, 3)).reshape(-1, 3)
        front = solid_depth < splat_depth
        image[front & there] = solid[front & there]
        # lines on a surface in front of the splats were covered by it
        on_front = behind & (front & there)[fragments["pixel"]]
        blend(image, fragments[~behind | on_front])
    return as_pixels(image).reshape(height, width, 3)


def as_pixels(image: np.ndarray) -> np.ndarray:
    """An image with values from 0 to 1, which are clipped to that, as uint8."""
    out: np.ndarray = (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)
    return out


def blend(image: np.ndarray, fragments: np.ndarray) -> None:
    """Blend (F,) `FRAGMENT` over an (H * W, 3) float32 image in 0 to 1, in place, far ones first."""
    if not len(fragments):
        return
    fragments = fragments[np.lexsort((fragments["depth"], fragments["pixel"]))]
    pixels = fragments["pixel"]
    starts = np.flatnonzero(np.r_[True, pixels[1:] != pixels[:-1]])
    rank = np.arange(len(pixels)) - np.repeat(starts, np.diff(np.r_[starts, len(pixels)]))
    for number in range(min(int(rank.max()), MOST_PER_PIXEL - 1), -1, -1):  # in a round, each pixel occurs once
        which = fragments[rank == number]
        at, cover = which["pixel"], which["cover"][:, None].astype(np.float32)
        image[at] += (which["color"].astype(np.float32) / 255 - image[at]) * cover
