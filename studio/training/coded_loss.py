"""The loss of fine-tuning on coded values: residual entropy and temporal loss, with their gradient, in one kernel: in
C++ on the CPU, for float32 in Triton on an NVIDIA GPU; else PyTorch."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import torch
from torch import Tensor, nn

from studio.rasterizer import available_backends
from studio.rasterizer.cpu import kernel_threads
from studio.rasterizer.kernels import kernels_for
from studio.training.regularizers import ResidualEntropy, temporal_loss
from studio.training.triton_coded import coded_loss_triton


class _Fused(torch.autograd.Function):
    """The weighted loss with its gradients, and the bits per splat, which have none."""

    @staticmethod
    def forward(
        ctx: Any, kernels: Any, owner: CodedLoss, seed: int, now: Tensor, mu: Tensor, log_sigma: Tensor
    ) -> tuple[Tensor, Tensor]:
        count, channels = now.shape
        columns = owner.entropy.owner
        sigma = log_sigma.detach().exp()
        gradient = torch.empty_like(now)
        by_mu, by_sigma = (torch.empty(channels, dtype=torch.float64) for _ in range(2))
        bits_weight = owner.entropy_weight / count
        bits, difference = kernels.coded_loss(
            now.detach().contiguous(),
            owner.before,
            owner.steps,
            mu.detach()[columns],
            sigma[columns],
            owner.huber,
            seed,
            bits_weight,
            owner.temporal_weight / owner.pixels,
            gradient,
            by_mu,
            by_sigma,
            kernel_threads(),
        )
        zeros = torch.zeros(len(mu), dtype=torch.float64)
        ctx.save_for_backward(
            gradient,
            (zeros.index_add(0, columns, by_mu) * bits_weight).to(mu.dtype),
            (zeros.index_add(0, columns, by_sigma) * bits_weight).to(mu.dtype) * sigma,
        )
        per_splat = now.new_tensor(bits / count)
        ctx.mark_non_differentiable(per_splat)
        return now.new_tensor(bits_weight * bits + owner.temporal_weight / owner.pixels * difference), per_splat

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        factor = float(upstream[0])
        gradients = ctx.saved_tensors if factor == 1.0 else [one * factor for one in ctx.saved_tensors]
        return None, None, None, *gradients


class CodedLoss(nn.Module):
    """Weighted sum of the residual entropy (paper equations 8 to 11) and the temporal loss (equation 12).

    Args:
        before: (N, C) coded values of frame t-1.
        steps: (C,) quantization step of each channel.
        attributes: columns of each attribute; see `ResidualEntropy`.
        pixels: W x H of equation 12.
        entropy_weight: weight of the bits per splat; 0: without.
        temporal_weight: weight of the temporal loss; 0: without.
        huber: width of its Huber loss in steps; see `temporal_loss`.

    Attributes:
        entropy: the distributions of the residuals; their parameters are learned.
    """

    def __init__(
        self,
        before: Tensor,
        steps: Tensor,
        attributes: Mapping[str, slice],
        pixels: int,
        entropy_weight: float,
        temporal_weight: float,
        huber: float = 0.0,
    ) -> None:
        super().__init__()
        self.before, self.steps, self.pixels = before.detach().contiguous(), steps, pixels
        self.entropy_weight, self.temporal_weight, self.huber = entropy_weight, temporal_weight, huber
        self.entropy = ResidualEntropy(before, steps, attributes)

    @cached_property
    def attribute_of_channel(self) -> Tensor:
        """(C,) int32, the index of the attribute of each channel."""
        return self.entropy.owner.int()

    @cached_property
    def channels_of_attribute(self) -> Tensor:
        """(attributes, C) float64: 1 where a channel belongs to an attribute."""
        return torch.nn.functional.one_hot(self.entropy.owner, len(self.entropy.mu)).T.double()

    def forward(self, now: Tensor, seed: int) -> tuple[Tensor, Tensor]:
        """The loss, a scalar, and the bits per splat, a scalar without gradient; 0 if `entropy_weight` is 0.

        Args:
            now: (N, C) coded values of frame t.
            seed: of the noise that simulates rounding, 0 to 2^32 - 1.
        """
        kernels = kernels_for(now, self.before, self.steps)
        if kernels is not None:
            entropy = self.entropy
            return _Fused.apply(kernels, self, seed, now, entropy.mu, entropy.log_sigma)  # type: ignore[no-untyped-call,no-any-return]
        if now.device.type == "cuda" and now.dtype == torch.float32 and "triton" in available_backends():
            return coded_loss_triton(self, self.entropy.mu, self.entropy.log_sigma, now, seed)
        return self.forward_torch(now, seed)

    def forward_torch(self, now: Tensor, seed: int) -> tuple[Tensor, Tensor]:
        """`forward` in plain PyTorch, for any device and dtype. This is the definition of the loss."""
        loss, bits = now.new_zeros(()), now.new_zeros(())
        if self.entropy_weight:
            bits = self.entropy(now, seed)
            loss = self.entropy_weight * bits
        if self.temporal_weight:
            difference = temporal_loss(now, self.before, self.pixels, self.steps, self.huber)
            loss = loss + self.temporal_weight * difference
        return loss, bits.detach()
