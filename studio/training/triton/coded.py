"""The loss on coded values on an NVIDIA GPU: one kernel of Triton instead of about sixty of PyTorch, and no wait.

A program computes one channel of a block of splats. Sums have a row for each program and no atomic operations, so that
the same input gives the same bits.
"""

# mypy: disable-error-code="no-untyped-def,untyped-decorator"
import math
from typing import Any

import torch
import triton
import triton.language as tl
from torch import Tensor

from v3studio.studio.training.known_gradients import with_gradients

WARPS = 4  # warps of a program
BLOCK = 512  # splats of a program
_BLOCK = tl.constexpr(BLOCK)
_LOG2E = tl.constexpr(1.4426950408889634)
_ROOT_HALF = tl.constexpr(0.70710678118654752)
_ROOT_2PI = tl.constexpr(0.39894228040143268)
_LEAST = tl.constexpr(1e-30)


@triton.jit
def _erfcx(x):
    """exp(x^2) erfc(x) for x >= 0: the Chebyshev fit of Numerical Recipes (relative error below 1.2e-7)."""
    t = 1.0 / (1.0 + 0.5 * x)
    p = 0.17087277 * t - 0.82215223
    p = p * t + 1.48851587
    p = p * t - 1.13520398
    p = p * t + 0.27886807
    p = p * t - 0.18628806
    p = p * t + 0.09678418
    p = p * t + 0.37409196
    p = p * t + 1.00002368
    p = p * t - 1.26551223
    return t * tl.exp2(p * _LOG2E)


@triton.jit
def _noise(index, seed):
    """Uniform in [-1/2, 1/2), the numbers of `studio.training.noise`."""
    x = index.to(tl.uint32) * 0x9E3779B9 + seed.to(tl.uint32)
    x ^= x >> 16
    x = x * 0x7FEB352D
    x ^= x >> 15
    x = x * 0x846CA68B
    x ^= x >> 16
    return (x >> 8).to(tl.float32) * (1.0 / 16777216.0) - 0.5


@triton.jit(do_not_specialize=["seed"])
def coded_loss(
    current, previous, steps, owner, mu, log_sigma, gradient, sums, count, channels, seed, bits_weight,
    difference_weight,
):  # fmt: skip
    """Bits of the residuals, differences to the previous frame, and their gradients.

    Args:
        current, previous: (N, C) float32 coded values.
        steps: (C,) float32 quantization steps.
        owner: (C,) int32 attribute of each channel.
        mu, log_sigma: (attributes,) float32 of the residuals' distributions.
        gradient: (N, C) float32, output: of the weighted loss with respect to `current`.
        sums: (blocks, C, 4) float32, output: bits, differences, and derivatives of the bits by mu and by sigma.
        count, channels: N and C.
        seed: of the noise.
        bits_weight, difference_weight: of a bit, and of a difference, in the loss.
    """
    channel = tl.program_id(1)
    splat = tl.program_id(0) * _BLOCK + tl.arange(0, _BLOCK)
    inside = splat < count
    element = splat * channels + channel
    step = tl.load(steps + channel)
    attribute = tl.load(owner + channel)
    mean = tl.load(mu + attribute)
    inverse_sigma = tl.exp2(-tl.load(log_sigma + attribute) * _LOG2E)
    now = tl.load(current + element, mask=inside, other=0.0)
    change = now - tl.load(previous + element, mask=inside, other=0.0)

    # Mirrored to the upper tail and relative to the nearer end of the interval, as `coded_loss.bits_of_residual`.
    centered = change / step + _noise(element, seed) - mean
    size = tl.abs(centered)
    low = (size - 0.5) * inverse_sigma
    high = (size + 0.5) * inverse_sigma
    holds_mean = low < 0.0
    tail_low = _erfcx(tl.abs(low) * _ROOT_HALF)
    tail_high = _erfcx(high * _ROOT_HALF)
    log_low = -0.5 * _LOG2E * low * low
    log_high = -0.5 * _LOG2E * high * high
    density_low = tl.exp2(log_low)
    density_high = tl.exp2(log_high)
    ratio = tl.exp2(log_high - log_low)
    p = tl.where(
        holds_mean,
        1.0 - 0.5 * (density_low * tail_low + density_high * tail_high),
        0.5 * (tail_low - ratio * tail_high),
    )
    p = tl.maximum(p, _LEAST)
    scale = _ROOT_2PI / p
    slope_low = tl.where(holds_mean, density_low * scale, scale)
    slope_high = tl.where(holds_mean, density_high * scale, ratio * scale)
    by_size = _LOG2E * inverse_sigma * (slope_low - slope_high)
    by_residual = tl.where(centered < 0.0, -by_size, by_size)
    bits = -tl.log2(p) - tl.where(holds_mean, 0.0, log_low)
    by_sigma = _LOG2E * inverse_sigma * (high * slope_high - low * slope_low)

    difference = tl.abs(change)
    slope = tl.where(change > 0.0, 1.0, tl.where(change < 0.0, -1.0, 0.0))

    tl.store(gradient + element, bits_weight / step * by_residual + difference_weight * slope, mask=inside)
    row = sums + (tl.program_id(0) * channels + channel) * 4
    tl.store(row, tl.sum(tl.where(inside, bits, 0.0), axis=0))
    tl.store(row + 1, tl.sum(tl.where(inside, difference, 0.0), axis=0))
    tl.store(row + 2, -tl.sum(tl.where(inside, by_residual, 0.0), axis=0))
    tl.store(row + 3, tl.sum(tl.where(inside, by_sigma, 0.0), axis=0))


def coded_loss_triton(owner: Any, now: Tensor, seed: int) -> tuple[Tensor, Tensor]:
    """`CodedLoss.forward` for float32 on an NVIDIA GPU; with Triton's interpreter, on the CPU. `owner`: the
    `CodedLoss`, whose module imports this one."""
    count, channels = now.shape
    blocks = math.ceil(count / BLOCK)
    data, mu, log_sigma = now.detach().contiguous(), owner.mu.detach(), owner.log_sigma.detach()
    gradient, sums = torch.empty_like(data), now.new_empty((blocks, channels, 4))
    bits_weight, difference_weight = owner.entropy_weight / count, owner.temporal_weight / owner.pixels
    with torch.cuda.device_of(data):
        coded_loss[(blocks, channels)](
            data, owner.before, owner.steps, owner.owner, mu, log_sigma, gradient, sums, count, channels, seed,
            bits_weight, difference_weight, num_warps=WARPS,
        )  # fmt: skip
    totals = sums.sum(0, dtype=torch.float64)  # (C, 4)
    # a product instead of index_add, whose order on a GPU, and so whose bits, would change
    by_attribute = (owner.channels_of_attribute @ totals[:, 2:] * bits_weight).unbind(1)
    by_mu, by_log_sigma = by_attribute[0].to(mu.dtype), by_attribute[1].to(mu.dtype) * log_sigma.exp()
    bits, difference = totals[:, :2].sum(0).unbind()
    per_splat = (bits / count if owner.entropy_weight else bits * 0).to(now.dtype)
    loss = (bits_weight * bits + difference_weight * difference).to(now.dtype)
    return with_gradients(loss, [now, owner.mu, owner.log_sigma], [gradient, by_mu, by_log_sigma]), per_splat
