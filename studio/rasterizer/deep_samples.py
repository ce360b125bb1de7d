"""Deep samples of a frame: what each pixel shows, front to back, so that compositors can put things in between.

Splats are blended in the order of their distances from the camera. Parts of that order are rendered one by one, so that
"over" of the parts is the image of all.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer.interface import rasterize
from v3studio.studio.rasterizer.types import Render


@dataclass(frozen=True)
class DeepSamples:
    """Samples front to back, by pixel (row by row): (M, 5) premultiplied color, alpha, and mean distance."""

    pixels: np.ndarray
    values: np.ndarray


def deep_samples(
    splats: Gaussians, camera: Camera, rendered: Render, most: int, linear: Callable[[np.ndarray], np.ndarray]
) -> DeepSamples:
    """At most `most` samples of a pixel, each of the same number of splats, whose "over" is the rendered image;
    `linear` maps (1, M, 4) premultiplied sRGB to the color space of the samples."""
    distances = torch.as_tensor(camera.project(splats.means.cpu().numpy())[1])
    seen = torch.nonzero(rendered.radii.cpu() > 0)[:, 0]
    ordered = seen[distances[seen].argsort(stable=True)]
    pixels, values = [], []
    for part in ordered.tensor_split(most):
        there, rows = _values(rasterize(splats[part.sort().values.to(splats.means.device)], camera))
        pixels.append(there)
        values.append(rows)
    at, rows = np.concatenate(pixels), np.concatenate(values)
    rows[:, :4] = linear(rows[None, :, :4])[0]
    # Splats are blended in sRGB; blending in linear light would give other colors.
    through, blended = np.ones((rendered.alpha.numel(), 1)), np.zeros((rendered.alpha.numel(), 3))
    ends = np.cumsum([len(there) for there in pixels])[:-1]
    for there, rgba in zip(pixels, np.split(rows[:, :4], ends), strict=True):
        blended[there] += through[there] * rgba[:, :3]
        through[there] *= 1 - rgba[:, 3:]
    drawn, meant = _values(rendered)
    wanted = np.zeros_like(blended)
    wanted[drawn] = linear(meant[None, :, :4])[0, :, :3]
    rows[:, :3] *= np.divide(wanted, blended, out=np.ones_like(blended), where=blended > 1e-6)[at]
    order = np.argsort(at, kind="stable")
    return DeepSamples(at[order], rows[order])


def _values(rendered: Render) -> tuple[np.ndarray, np.ndarray]:
    """The pixels in which something is drawn, and (M, 5) their premultiplied color, alpha and distance."""
    layers = torch.cat([rendered.image, rendered.alpha[..., None], rendered.depth[..., None]], -1).reshape(-1, 5)
    pixels = torch.nonzero(layers[:, 3] > 0)[:, 0]
    return pixels.cpu().numpy(), layers[pixels].cpu().numpy()
