"""Residual entropy and temporal losses (paper section 4.2, equations 8 to 12).

Both act on the values that the baker quantises: unit quaternions with continuous sign, log scales, opacities, SH.
Positions are the motion stage's alone (the paper sums over R, S, o, c, SH).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from studio.gaussians import Gaussians

_TAIL = 1e-3
"""Probability under which the float32 difference of two CDF values has lost too many digits."""


def baked_values(gaussians: Gaussians, reference_quats: Tensor) -> dict[str, Tensor]:
    """Name to (N, C) tensors as the stream stores them: rotation, scale, opacity, colour and, if any, SH rest.

    Args:
        gaussians: N splats.
        reference_quats: (N, 4) unit quaternions; each of ours takes the sign that is nearer to its reference (q and
            -q are one rotation).
    """
    quats = gaussians.unit_quats
    sign = torch.where((quats.detach() * reference_quats).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    values = {
        "rotation": quats * sign,
        "scale": gaussians.log_scales,
        "opacity": gaussians.opacities[:, None],
        "color": gaussians.sh[:, 0],
    }
    if gaussians.sh.shape[1] > 1:
        values["sh"] = gaussians.sh[:, 1:].flatten(1)
    return values


def quantisation_steps(values: dict[str, Tensor], levels: int = 256) -> dict[str, Tensor]:
    """(C,) step of each channel when its range is cut into `levels` values, as the baker does."""
    return {
        name: ((value.amax(0) - value.amin(0)) / (levels - 1)).clamp_min(1e-8).detach()
        for name, value in values.items()
    }


def bits_of_residual(residual: Tensor, mu: Tensor, sigma: Tensor) -> Tensor:
    """-log2 P of equation 10 for each element: P = Phi((r + 1/2 - mu) / sigma) - Phi((r - 1/2 - mu) / sigma).

    Exact in the tails too, where the difference of two float32 CDF values would be 0 and its logarithm infinite.

    Args:
        residual: any shape, in quantisation steps, noise included.
        mu, sigma: scalars, in quantisation steps; sigma > 0.
    """
    centred = residual - mu
    inverse = 1 / (sigma * math.sqrt(2))
    probability = 0.5 * (torch.erf((centred + 0.5) * inverse) - torch.erf((centred - 0.5) * inverse))
    bits = -torch.log2(probability.clamp_min(_TAIL))
    tail = probability.detach() < _TAIL
    if tail.any():
        # P is symmetric about mu: mirror to the lower tail, where log Phi keeps its digits.
        lower = -centred[tail].abs()
        below = torch.special.log_ndtr((lower - 0.5) / sigma)
        above = torch.special.log_ndtr((lower + 0.5) / sigma)
        log_p = above + torch.log1p(-torch.exp((below - above).clamp(max=-1e-12)))
        bits = bits.masked_scatter(tail, -log_p / math.log(2))
    return bits


class ResidualEntropy(nn.Module):
    """Equations 8 to 11: expected bits a splat of the quantised frame-to-frame residuals.

    Each attribute has its own learnable mean and deviation (in quantisation steps). Equation 9 subtracts y_min from
    the residual; being constant, that offset is part of the learnable mean here.

    Args:
        previous: baked values of frame t-1.
        steps: quantisation step of each channel.
    """

    def __init__(self, previous: dict[str, Tensor], steps: dict[str, Tensor]) -> None:
        super().__init__()
        self._previous = {name: value.detach() for name, value in previous.items()}
        self._steps = steps
        device = next(iter(previous.values())).device
        self.mu = nn.ParameterDict({name: nn.Parameter(torch.zeros((), device=device)) for name in previous})
        self.log_sigma = nn.ParameterDict({name: nn.Parameter(torch.zeros((), device=device)) for name in previous})

    def forward(self, current: dict[str, Tensor], generator: torch.Generator) -> Tensor:
        """Scalar: bits a splat, summed over the elements of all attributes, averaged over the N splats.

        Args:
            current: baked values of frame t.
            generator: draws the uniform noise, one value an element, that stands for rounding.
        """
        total = torch.zeros((), device=next(iter(current.values())).device)
        for name, value in current.items():
            residual = (value - self._previous[name]) / self._steps[name]
            noise = torch.rand(residual.shape, generator=generator, dtype=residual.dtype).to(residual.device) - 0.5
            bits = bits_of_residual(residual + noise, self.mu[name], self.log_sigma[name].exp())
            total = total + bits.sum() / value.shape[0]
        return total


def temporal_loss(current: dict[str, Tensor], previous: dict[str, Tensor], plane_pixels: int) -> Tensor:
    """Equation 12: sum over attributes of |y_t - y_{t-1}|_1, divided by W x H of the Gaussian video's plane."""
    return (
        sum(
            ((value - previous[name]).abs().sum() for name, value in current.items()),
            start=torch.zeros((), device=next(iter(current.values())).device),
        )
        / plane_pixels
    )
