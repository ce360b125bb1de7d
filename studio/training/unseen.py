"""Colors of splats that hardly any camera sees: those of the splats around them.

Where no camera looks, nothing splits splats, so they are large, and a few pixels at their rim decide on their color:
those of an outline, where masks are least exact. A new view of such a place shows that color all over it.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer.contribution import contribution

_ENOUGH = 0.1  # cameras that see a splat, see `cameras_that_see`, for half of its color to be its own
_NEIGHBORS, _ROUNDS = 12, 40


def cameras_that_see(gaussians: Gaussians, cameras: Sequence[Camera]) -> np.ndarray:
    """(N,) float64 number of cameras that see each splat; one that sees a part of it, or at an angle, counts in part.

    It is what the splat contributes to the image, relative to what it would if it were alone and faced the camera: the
    integral of its opacity, 2 pi times the product of its two largest scales in pixels times the opacity.
    """
    scales = gaussians.scales.double().sort(-1).values
    means = gaussians.means.double().cpu().numpy()
    whole = (2 * torch.pi * scales[:, 1] * scales[:, 2] * gaussians.opacities).cpu().numpy()
    seen = np.zeros(len(gaussians))
    for camera in cameras:
        size = camera.project(means)[1].clip(0) / camera.fx  # of a pixel there; what is behind the camera has none
        seen += contribution(gaussians, [camera]).cpu().numpy() * size**2
    return seen / np.maximum(whole, np.finfo(np.float64).tiny)


def settled_colors(gaussians: Gaussians, cameras: Sequence[Camera]) -> Tensor:
    """(N, K, 3) spherical harmonics, in which splats that hardly any of the cameras sees have those around them."""
    from scipy.spatial import cKDTree

    seen = cameras_that_see(gaussians, cameras) ** 2
    own = seen / (seen + _ENOUGH**2)
    means = gaussians.means.cpu().numpy()
    around = cKDTree(means).query(means, k=min(_NEIGHBORS + 1, len(means)))[1][:, 1:]
    weights = own[around] + 1e-3
    weights = ((1 - own) / weights.sum(1))[:, None] * weights
    given = gaussians.sh.flatten(1).cpu().double().numpy()
    settled = given
    for _ in range(_ROUNDS):
        settled = own[:, None] * given + np.einsum("nk,nkc->nc", weights, settled[around])
    return torch.from_numpy(settled).to(gaussians.sh).reshape(gaussians.sh.shape)
