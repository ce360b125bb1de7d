"""Entropy and temporal losses against scipy and closed forms."""

import math

import numpy as np
import pytest
import torch
from scipy.stats import norm

from studio.gaussians import Gaussians
from studio.training.regularisers import (
    ResidualEntropy,
    baked_values,
    bits_of_residual,
    quantisation_steps,
    temporal_loss,
)


@pytest.mark.parametrize("sigma", [0.05, 0.3, 1.0, 7.0])
@pytest.mark.parametrize("mu", [0.0, -2.5])
def test_bits_equal_scipy(mu: float, sigma: float) -> None:
    residual = torch.cat([torch.linspace(-4, 4, 81) * max(sigma, 0.3) + mu, torch.tensor([mu + 9 * sigma])])
    values = residual.double().numpy()
    lower = -np.abs(values - mu)
    expected = -(
        norm.logcdf((lower + 0.5) / sigma)
        + np.log1p(-np.exp(norm.logcdf((lower - 0.5) / sigma) - norm.logcdf((lower + 0.5) / sigma)))
    ) / math.log(2)
    bits = bits_of_residual(residual, torch.tensor(mu), torch.tensor(sigma))
    assert np.allclose(bits.numpy(), expected, rtol=2e-3, atol=2e-4)


def test_bits_have_finite_gradients_far_out() -> None:
    residual = torch.tensor([0.0, 5.0, 60.0, -400.0], requires_grad=True)
    mu, sigma = torch.zeros((), requires_grad=True), torch.ones((), requires_grad=True)
    bits = bits_of_residual(residual, mu, sigma)
    bits.sum().backward()
    assert torch.isfinite(bits).all() and torch.isfinite(residual.grad).all() and torch.isfinite(sigma.grad)
    assert residual.grad[2] > 0 > residual.grad[3], "the loss pulls residuals towards the mean"


def test_learnt_entropy_reaches_that_of_the_data() -> None:
    """Fitted to Gaussian residuals of deviation 3 steps, the bits equal a Gaussian's differential entropy."""
    torch.manual_seed(0)
    values = {"opacity": torch.zeros(20000, 1)}
    current = {"opacity": 1.5 + 3 * torch.randn(20000, 1)}
    loss = ResidualEntropy(values, {"opacity": torch.ones(1)})
    adam = torch.optim.Adam(loss.parameters(), lr=0.05)
    generator = torch.Generator().manual_seed(1)
    for _ in range(200):
        adam.zero_grad()
        loss(current, generator).backward()
        adam.step()
    assert float(loss.mu["opacity"]) == pytest.approx(1.5, abs=0.15)
    exact = 0.5 * math.log2(2 * math.pi * math.e * (9 + 1 / 12))
    assert float(loss(current, generator)) == pytest.approx(exact, abs=0.05)


def test_entropy_sums_attributes_and_averages_splats() -> None:
    values = {"scale": torch.zeros(50, 3), "opacity": torch.zeros(50, 1)}
    steps = {"scale": torch.full((3,), 0.1), "opacity": torch.ones(1)}
    generator = torch.Generator().manual_seed(3)
    total = ResidualEntropy(values, steps)(values, generator)
    noise = torch.Generator().manual_seed(3)
    zero, one = torch.zeros(()), torch.ones(())
    expected = sum(
        bits_of_residual(torch.rand(shape, generator=noise) - 0.5, zero, one).sum() / 50 for shape in [(50, 3), (50, 1)]
    )
    assert float(total) == pytest.approx(float(expected), rel=1e-5)


def random_gaussians(count: int, degree: int = 1) -> Gaussians:
    return Gaussians(
        torch.randn(count, 3),
        torch.randn(count, 4),
        torch.randn(count, 3),
        torch.randn(count),
        torch.randn(count, (degree + 1) ** 2, 3),
    )


def test_negated_quaternions_are_the_same_rotation() -> None:
    before = random_gaussians(20)
    flipped = Gaussians(before.means, -3 * before.quats, before.log_scales, before.logit_opacities, before.sh)
    reference = before.unit_quats
    one, other = baked_values(before, reference), baked_values(flipped, reference)
    assert all(torch.allclose(one[name], other[name], atol=1e-6) for name in one)
    assert set(one) == {"rotation", "scale", "opacity", "color", "sh"}
    assert float(temporal_loss(one, other, 64)) == pytest.approx(0, abs=1e-4)


def test_temporal_loss_is_the_sum_over_the_plane() -> None:
    before = {"scale": torch.zeros(10, 3), "color": torch.ones(10, 3)}
    now = {"scale": torch.full((10, 3), -0.5), "color": torch.full((10, 3), 3.0)}
    assert float(temporal_loss(now, before, 64)) == pytest.approx((15 + 60) / 64)


def test_steps_are_those_of_eight_bits() -> None:
    values = {"scale": torch.tensor([[0.0, 1.0], [2.55, 1.0]])}
    step = quantisation_steps(values)["scale"]
    assert float(step[0]) == pytest.approx(0.01) and float(step[1]) > 0
