"""What every backend takes and gives, and the constants of the definition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from torch import Tensor

from studio.cameras import Camera
from studio.errors import StudioError

DILATION = 0.3
"""Added to the diagonal of every screen-space covariance, square pixels (3DGS: at least about a pixel wide)."""

ALPHA_MIN = 1.0 / 255.0
"""A splat adds nothing to a pixel where its alpha is below this (3DGS)."""

TRANSMITTANCE_MIN = 1.00001e-4
"""Blending of a pixel stops before the splat that would bring its transmittance to this or below (3DGS: 1e-4).

A hair above 1e-4, because two splats at the clamp of 0.99 leave exactly that: with the margin they end the pixel
whatever the rounding, as they do in 3DGS.
"""

ALPHA_MAX = 0.99
"""Alpha's upper clamp in 3DGS. gsplat 1.5.3 has 0.999 compiled in."""

FIELD = 2.0
"""The projection of a splat is linearized at its center, but at most this far (x / z, y / z) off the viewing axis.

A bound keeps splats close beside the camera from growing over the whole image. 3DGS and gsplat put it a little outside
the image, which makes a cropped view differ from a part of the whole one; a fixed 63 degrees does not.
"""

FIELD_MARGIN = 0.3
"""In views wider than `FIELD` the bound lies outside the image by this part of half its size, as in gsplat."""


@dataclass(eq=False)
class Render:
    """One drawn view.

    Attributes:
        image: (H, W, 3) RGB over the background, linear in the colors of the splats (not clamped above 1).
        alpha: (H, W) in 0 to 1: one minus the transmittance that is left.
        depth: (H, W) expected depth along the viewing axis, world units: sum of weight times depth over sum of
            weights; 0 where nothing was drawn.
        radii: (N,) pixels, no gradient: the larger half side of the smallest box outside which the splat's alpha is
            below 1/255; 0 for a splat that was not drawn (behind the near plane, outside the image, opacity below
            1/255, not finite).
    """

    image: Tensor
    alpha: Tensor
    depth: Tensor
    radii: Tensor


@dataclass(frozen=True)
class Pinhole:
    """A camera as the kernels take it: plain numbers, checked.

    Attributes:
        rotation: (3, 3) float64 world to camera; translation, center: (3,) float64.
        fx, fy, cx, cy: pixels; the principal point may lie anywhere.
        limits: (4,) lowest and highest x / z, lowest and highest y / z at which the projection is linearized.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    rotation: np.ndarray
    translation: np.ndarray
    center: np.ndarray
    limits: tuple[float, float, float, float]

    @classmethod
    def of(cls, camera: Camera) -> Pinhole:
        """From a Camera.

        Raises:
            StudioError: the camera has lens distortion or skew.
        """
        if not camera.is_pinhole:
            raise StudioError(
                f"Camera '{camera.name}' has lens distortion, which splats cannot be drawn with; "
                "undistort the images and use camera.undistorted()."
            )
        if abs(camera.K[0, 1]) > 1e-9 * camera.fx:
            raise StudioError(f"Camera '{camera.name}' has skew ({camera.K[0, 1]:g}), which cannot be drawn.")
        margin_x = FIELD_MARGIN * 0.5 * camera.width / camera.fx
        margin_y = FIELD_MARGIN * 0.5 * camera.height / camera.fy
        return cls(
            width=camera.width,
            height=camera.height,
            fx=camera.fx,
            fy=camera.fy,
            cx=camera.cx,
            cy=camera.cy,
            rotation=camera.rotation,
            translation=camera.translation,
            center=camera.center,
            limits=(
                min(-FIELD, -camera.cx / camera.fx - margin_x),
                max(FIELD, (camera.width - camera.cx) / camera.fx + margin_x),
                min(-FIELD, -camera.cy / camera.fy - margin_y),
                max(FIELD, (camera.height - camera.cy) / camera.fy + margin_y),
            ),
        )
