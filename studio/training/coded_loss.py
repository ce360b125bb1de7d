"""Losses on the values that the stream codes (paper section 4.2): residual entropy, equations 8 to 11, and the temporal
loss, equation 12.

The paper sums over rotation, scale, opacity, color and SH; means belong to the motion stage. All channels are columns
of one (N, C) tensor, since the overhead of many small tensors would exceed the time of the arithmetic.

One kernel computes the loss and its gradient: in C++ on the CPU, for float32 in Triton on an NVIDIA GPU. Elsewhere,
PyTorch does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import torch
from torch import Tensor, nn

from v3studio.studio.rasterizer.cpu import kernel_threads
from v3studio.studio.rasterizer.kernels import kernels_for, uses_triton
from v3studio.studio.training.known_gradients import with_gradients
from v3studio.studio.training.noise import uniform

_LEAST = 1e-30  # below any P that occurs, relative to the density at the nearer end


def bits_of_residual(residual: Tensor, mu: Tensor, sigma: Tensor) -> Tensor:
    """Equation 10: -log2 P per element, with P = Phi((r + 1/2 - mu) / sigma) - Phi((r - 1/2 - mu) / sigma).

    Also exact in the tails, where the difference of two CDF values would be 0.

    Args:
        residual: (..., C) in quantization steps, noise included.
        mu, sigma: () or (C,), equal shapes, in quantization steps; sigma > 0.
    """
    # P is symmetric, so the interval is mirrored to the upper side. Relative to the density at its nearer end, P has
    # full precision in both tails.
    size = (residual - mu).abs()
    near, far = (size - 0.5) / sigma, (size + 0.5) / sigma
    holds_mean = near < 0
    log_near, log_far = -0.5 * near * near, -0.5 * far * far
    above = torch.where(holds_mean, -near, near)  # abs() has no gradient at 0
    tail_near, tail_far = (torch.special.erfcx(end * math.sqrt(0.5)) for end in (above, far))
    scaled = torch.where(
        holds_mean,
        1 - 0.5 * (log_near.exp() * tail_near + log_far.exp() * tail_far),
        0.5 * (tail_near - (log_far - log_near).exp() * tail_far),
    ).clamp_min(_LEAST)
    return -torch.log2(scaled) - torch.where(holds_mean, 0.0, log_near) / math.log(2)


def _fused(kernels: Any, loss: CodedLoss, now: Tensor, seed: int) -> tuple[Tensor, Tensor]:
    """The weighted loss with its gradients, and the bits per splat, which have none."""
    count, channels = now.shape
    columns, mu, sigma = loss.owner, loss.mu.detach(), loss.log_sigma.detach().exp()
    gradient = torch.empty_like(now)
    by_mu, by_sigma = (torch.empty(channels, dtype=torch.float64) for _ in range(2))
    bits_weight, difference_weight = loss.entropy_weight / count, loss.temporal_weight / loss.pixels
    bits, difference = kernels.coded_loss(
        now.detach().contiguous(), loss.before, loss.steps, mu[columns], sigma[columns], seed, bits_weight,
        difference_weight, gradient, by_mu, by_sigma, kernel_threads(),
    )  # fmt: skip
    zeros = torch.zeros(len(mu), dtype=torch.float64)
    by_mu, by_sigma = ((zeros.index_add(0, columns, slope) * bits_weight).to(mu.dtype) for slope in (by_mu, by_sigma))
    value = now.new_tensor(bits_weight * bits + difference_weight * difference)
    inputs, gradients = [now, loss.mu, loss.log_sigma], [gradient, by_mu, by_sigma * sigma]
    return with_gradients(value, inputs, gradients), now.new_tensor(bits / count)


class CodedLoss(nn.Module):
    """Weighted sum of the residual entropy (paper equations 8 to 11) and the temporal loss (equation 12).

    The residual entropy is the expected bits per splat of the quantized frame-to-frame residuals. Each attribute has a
    learnable mean and standard deviation, in quantization steps. The constant y_min that equation 9 subtracts from the
    residual is included in the learnable mean.

    Args:
        before: (N, C) coded values of frame t-1.
        steps: (C,) quantization step of each channel.
        attributes: columns of each attribute; they share a mean and a deviation.
        pixels: W x H of equation 12.
        entropy_weight: weight of the bits per splat; 0: without.
        temporal_weight: weight of the temporal loss; 0: without.

    Attributes:
        owner: (C,) int32, the index of the attribute of each channel.
        mu, log_sigma: (attributes,) the learned means and logarithms of the deviations.
    """

    owner: Tensor

    def __init__(
        self,
        before: Tensor,
        steps: Tensor,
        attributes: Mapping[str, slice],
        pixels: int,
        entropy_weight: float,
        temporal_weight: float,
    ) -> None:
        super().__init__()
        self.before, self.steps, self.pixels = before.detach().contiguous(), steps, pixels
        self.entropy_weight, self.temporal_weight = entropy_weight, temporal_weight
        owner = torch.zeros(before.shape[1], dtype=torch.int32)
        for index, columns in enumerate(attributes.values()):
            owner[columns] = index
        self.register_buffer("owner", owner.to(before.device))
        self.mu = nn.Parameter(torch.zeros(len(attributes), device=before.device))
        self.log_sigma = nn.Parameter(torch.zeros(len(attributes), device=before.device))

    @cached_property
    def channels_of_attribute(self) -> Tensor:
        """(attributes, C) float64: 1 where a channel belongs to an attribute."""
        return torch.nn.functional.one_hot(self.owner.long(), len(self.mu)).T.double()

    def forward(self, now: Tensor, seed: int) -> tuple[Tensor, Tensor]:
        """The loss, a scalar, and the bits per splat, a scalar without gradient; 0 if `entropy_weight` is 0.

        Args:
            now: (N, C) coded values of frame t.
            seed: of the noise that simulates rounding, 0 to 2^32 - 1.
        """
        kernels = kernels_for(now, self.before, self.steps)
        if kernels is not None:
            return _fused(kernels, self, now, seed)
        if uses_triton(now):
            from v3studio.studio.training.triton.coded import coded_loss_triton

            return coded_loss_triton(self, now, seed)
        return self.forward_torch(now, seed)

    def forward_torch(self, now: Tensor, seed: int) -> tuple[Tensor, Tensor]:
        """`forward` in plain PyTorch, for any device and dtype. This is the definition of the loss."""
        loss, bits = now.new_zeros(()), now.new_zeros(())
        if self.entropy_weight:
            noise = uniform(now.numel(), seed, now.dtype, now.device).reshape(now.shape) - 0.5
            residual = now / self.steps - self.before / self.steps + noise
            bits = bits_of_residual(residual, self.mu[self.owner], self.log_sigma.exp()[self.owner]).sum() / len(now)
            loss = self.entropy_weight * bits
        if self.temporal_weight:
            difference = (now - self.before).abs().sum() / self.pixels  # by attribute and splat, |y_t - y_t-1|_1
            loss = loss + self.temporal_weight * difference
        return loss, bits.detach()
