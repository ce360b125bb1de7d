"""Coding of the profile `planes`: each number of a splat in 8 bits over its range (paper, "Quantization")."""

from __future__ import annotations

import torch
from torch import Tensor

from studio.gaussians import Gaussians
from studio.stream.layout import plane_side
from studio.stream.profiles.coding import SplatCoding
from studio.stream.quantize import LEVELS_8

_MIN_STEP = 1e-3


class PlanesCoding(SplatCoding):
    """Unit quaternions with continuous sign, log scales, opacities and SH, each cut into 256 levels."""

    profile = "planes"

    def __init__(self, previous: Gaussians) -> None:
        self.attributes = {
            "rotation": slice(0, 4),
            "scale": slice(4, 7),
            "opacity": slice(7, 8),
            "color": slice(8, 11),
        }
        if previous.sh_degree > 0:
            self.attributes["sh"] = slice(11, 8 + 3 * (previous.sh_degree + 1) ** 2)
        self.pixels = plane_side(len(previous)) ** 2
        self._quats = previous.unit_quats

    def coded_values(self, gaussians: Gaussians) -> Tensor:
        """See `SplatCoding`. Each quaternion has the sign that is nearer to the previous frame (q and -q are the same
        rotation)."""
        quats = gaussians.unit_quats
        sign = torch.where((quats.detach() * self._quats).sum(-1, keepdim=True) < 0, -1.0, 1.0)
        return torch.cat(
            [quats * sign, gaussians.log_scales, gaussians.opacities[:, None], gaussians.sh.flatten(1)], dim=1
        )

    def quantizer(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """See `SplatCoding`. Steps are at least 1e-3: a channel that is nearly constant in this frame has a larger
        range over the group."""
        low = values.amin(0)
        steps = ((values.amax(0) - low) / LEVELS_8).clamp_min(_MIN_STEP)
        return low.detach(), steps.detach()

    def decode(self, gaussians: Gaussians, values: Tensor) -> Gaussians:
        """See `SplatCoding`."""
        return Gaussians(
            gaussians.means,
            values[:, :4],
            values[:, 4:7],
            torch.logit(values[:, 7].clamp(1e-4, 1 - 1e-4)),
            values[:, 8:].reshape(gaussians.sh.shape),
        )
