"""Residual entropy and temporal losses (paper section 4.2, equations 8 to 12).

Both act on the values that a stream profile codes (`studio.stream.profiles`). The paper sums over rotation, scale,
opacity, color and SH; means belong to the motion stage. All channels are columns of one (N, C) tensor, since the
overhead of many small tensors would exceed the time of the arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn

from studio.gaussians import Gaussians
from studio.stream.profiles import SplatCoding
from studio.training.noise import uniform

Quantizer = tuple[Tensor, Tensor]

_LEAST = 1e-30
"""Below any P that occurs, relative to the density at the nearer end."""


class _Bits(torch.autograd.Function):
    """-log2 P with its closed-form gradient, which needs a third of the memory traffic of autograd."""

    @staticmethod
    def forward(ctx: Any, residual: Tensor, mu: Tensor, sigma: Tensor) -> Tensor:
        # P is symmetric, so the interval is mirrored to the upper side. Relative to the density at its nearer end, P
        # has full precision in both tails, and no element needs another treatment, which would stall a GPU.
        centered = residual - mu
        inverse = 1 / sigma
        size = centered.abs()
        near, far = (size - 0.5) * inverse, (size + 0.5) * inverse
        holds_mean = near < 0
        log_near, log_far = -0.5 * near * near, -0.5 * far * far
        tail_near, tail_far = (torch.special.erfcx(end * math.sqrt(0.5)) for end in (near.abs(), far))
        density_near, density_far, ratio = log_near.exp(), log_far.exp(), (log_far - log_near).exp()
        scaled = torch.where(
            holds_mean,
            1 - 0.5 * (density_near * tail_near + density_far * tail_far),
            0.5 * (tail_near - ratio * tail_far),
        ).clamp_min(_LEAST)
        bits = -torch.log2(scaled) - torch.where(holds_mean, 0.0, log_near) / math.log(2)
        # Densities at both ends, divided by P; all gradients are combinations of these.
        scale = 1 / (math.sqrt(2 * math.pi) * scaled)
        near_slope = torch.where(holds_mean, density_near, 1.0) * scale
        far_slope = torch.where(holds_mean, density_far, ratio) * scale
        ctx.save_for_backward(near, far, near_slope, far_slope, inverse, torch.where(centered < 0, -1.0, 1.0))
        ctx.mu_shape = mu.shape
        return bits

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        near, far, near_slope, far_slope, inverse, side = ctx.saved_tensors
        weight = gradients[0] * inverse / math.log(2)
        by_residual = (weight * side * (near_slope - far_slope)).to(weight.dtype)
        by_sigma = weight * (far * far_slope - near * near_slope)
        return by_residual, -by_residual.sum_to_size(ctx.mu_shape), by_sigma.sum_to_size(ctx.mu_shape)


def bits_of_residual(residual: Tensor, mu: Tensor, sigma: Tensor) -> Tensor:
    """Equation 10: -log2 P per element, with P = Phi((r + 1/2 - mu) / sigma) - Phi((r - 1/2 - mu) / sigma).

    Also exact in the tails, where the difference of two CDF values would be 0.

    Args:
        residual: (..., C) in quantization steps, noise included.
        mu, sigma: () or (C,), equal shapes, in quantization steps; sigma > 0.
    """
    return _Bits.apply(residual, mu, sigma)  # type: ignore[no-untyped-call,no-any-return]


class ResidualEntropy(nn.Module):
    """Equations 8 to 11: expected bits per splat of the quantized frame-to-frame residuals.

    Each attribute has a learnable mean and standard deviation, in quantization steps. The constant y_min that equation
    9 subtracts from the residual is included in the learnable mean.

    Args:
        previous: (N, C) coded values of frame t-1.
        steps: (C,) quantization step of each channel.
        attributes: columns of each attribute; they share a mean and a deviation.

    Attributes:
        owner: (C,) int64, the index of the attribute of each channel.
        mu, log_sigma: (attributes,) the learned means and logarithms of the deviations.
    """

    owner: Tensor
    _previous: Tensor
    _steps: Tensor

    def __init__(self, previous: Tensor, steps: Tensor, attributes: Mapping[str, slice]) -> None:
        super().__init__()
        owner = torch.zeros(previous.shape[1], dtype=torch.long)
        for index, columns in enumerate(attributes.values()):
            owner[columns] = index
        self.register_buffer("owner", owner.to(previous.device))
        self.register_buffer("_previous", previous.detach() / steps)
        self.register_buffer("_steps", steps)
        self.mu = nn.Parameter(torch.zeros(len(attributes), device=previous.device))
        self.log_sigma = nn.Parameter(torch.zeros(len(attributes), device=previous.device))

    def forward(self, current: Tensor, seed: int) -> Tensor:
        """Scalar: bits per splat, summed over the channels of all attributes and averaged over the N splats.

        Args:
            current: (N, C) coded values of frame t.
            seed: of the uniform noise per element that simulates rounding, 0 to 2^32 - 1.
        """
        noise = uniform(current.numel(), seed, current.dtype, current.device).reshape(current.shape) - 0.5
        residual = current / self._steps - self._previous + noise
        bits = bits_of_residual(residual, self.mu[self.owner], self.log_sigma.exp()[self.owner])
        return bits.sum() / current.shape[0]


def temporal_loss(
    current: Tensor, previous: Tensor, plane_pixels: int, steps: Tensor | None = None, huber: float = 0.0
) -> Tensor:
    """Equation 12: sum over attributes of |y_t - y_{t-1}|_1, divided by W x H of the Gaussian video.

    Args:
        current, previous: (N, C) coded values.
        plane_pixels: W x H.
        steps: (C,) quantization steps; required if `huber` is above 0.
        huber: if above 0, use a Huber loss with this width in quantization steps: quadratic below it, and equation 12
            minus half the width above it.
    """
    difference = (current - previous).abs()
    if huber > 0:
        if steps is None:
            raise ValueError("a Huber loss needs the quantization steps")
        width = huber * steps
        difference = torch.where(difference < width, 0.5 * difference * difference / width, difference - 0.5 * width)
    return difference.sum() / plane_pixels


def simulate_quantization(coding: SplatCoding, gaussians: Gaussians, values: Tensor, quantizer: Quantizer) -> Gaussians:
    """The splats with attributes rounded as the baker rounds them; gradients pass straight through the rounding.

    Args:
        coding: the coding of the stream profile.
        gaussians: N splats, from which means and the number of SH coefficients are taken.
        values: (N, C) coded values of the splats.
        quantizer: (C,) offset and (C,) step of each channel.
    """
    low, steps = quantizer
    rounded = torch.round((values.detach() - low) / steps) * steps + low
    return coding.decode(gaussians, values + (rounded - values).detach())
