"""Inputs and outputs that all backends share, and the constants of the definition."""

from dataclasses import dataclass

import torch
from torch import Tensor

from v3studio.studio.cameras import Camera
from v3studio.studio.counts import short_repr
from v3studio.studio.errors import StudioError

ALPHA_MIN = 1.0 / 255.0  # A splat does not contribute to a pixel where its alpha is below this value (3DGS)

TRANSMITTANCE_MIN = 1.00001e-4
"""A pixel stops before the splat that would reduce its transmittance to this value or below (3DGS: 1e-4).

Slightly above 1e-4, because two splats at the alpha clamp of 0.99 leave exactly 1e-4. With this margin they stop the
pixel regardless of rounding, as in 3DGS.
"""

ALPHA_MAX = 0.99  # upper clamp of alpha in 3DGS

NEAR = 0.01  # near plane, world units: splats whose mean is closer along the viewing axis are not drawn

FIELD = 2.0
"""The projection of a splat is linearized at its mean, with |x / z| and |y / z| clamped to this value.

Without the clamp, splats beside the camera would cover the whole image. 3DGS and gsplat clamp slightly outside the
image, which makes a crop differ from the same part of the full view. A fixed bound (63 degrees) avoids that.
"""

FIELD_MARGIN = 0.3
"""Bound in views wider than `FIELD`: so large a fraction of half the image size outside the image, as in gsplat."""


@dataclass(eq=False)
class Render:
    """A rendered view.

    Attributes:
        image: (H, W, 3) RGB over the background, linear in the colors of the splats and not clamped to 1.
        alpha: (H, W) in 0 to 1: one minus the final transmittance.
        depth: (H, W) expected depth along the viewing axis, world units: sum of weight times depth over sum of
            weights; 0 where nothing was drawn.
        radii: (N,) pixels, without gradient: the larger half size of the smallest box outside which the splat's alpha
            is below 1/255; 0 for splats that were not rendered (closer than the near plane, outside the image, opacity
            below 1/255, not finite).
    """

    image: Tensor
    alpha: Tensor
    depth: Tensor
    radii: Tensor

    __repr__ = short_repr


def check_pinhole(camera: Camera) -> None:
    """StudioError (`camera.distortion`, `camera.skew`) for a camera that splats cannot be drawn for."""
    if not camera.is_pinhole:
        problem = f"camera '{camera.name}' has lens distortion, which the rasterizer does not support"
        fix = "Undistort the images and use camera.undistorted()"
        raise StudioError("camera.distortion", problem, fix=fix, camera=camera.name)
    if abs(camera.K[0, 1]) > 1e-9 * camera.fx:
        problem = f"camera '{camera.name}' has skew {camera.K[0, 1]:g}, which the rasterizer does not support"
        raise StudioError("camera.skew", problem, value=float(camera.K[0, 1]), camera=camera.name)


def field_limits(camera: Camera) -> tuple[float, float, float, float]:
    """Least and greatest x / z, and y / z, at which the projection is linearized; see `FIELD`."""
    margin_x = FIELD_MARGIN * 0.5 * camera.width / camera.fx
    margin_y = FIELD_MARGIN * 0.5 * camera.height / camera.fy
    return (
        min(-FIELD, -camera.cx / camera.fx - margin_x),
        max(FIELD, (camera.width - camera.cx) / camera.fx + margin_x),
        min(-FIELD, -camera.cy / camera.fy - margin_y),
        max(FIELD, (camera.height - camera.cy) / camera.fy + margin_y),
    )


def mean_depth(weighted: Tensor, alpha: Tensor) -> Tensor:
    """(H, W) depths of pixels from the sums of weight times depth and of weights; 0 where nothing is drawn."""
    covered = alpha > 0
    return torch.where(covered, weighted / torch.where(covered, alpha, torch.ones_like(alpha)), 0.0)
