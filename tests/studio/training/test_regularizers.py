"""Entropy and temporal losses against scipy and closed forms."""

import math

import numpy as np
import pytest
import torch
from scipy.stats import norm

from studio.gaussians import Gaussians
from studio.stream.profiles import coding_of
from studio.training.noise import uniform
from studio.training.regularizers import ResidualEntropy, bits_of_residual, simulate_quantization, temporal_loss

ATTRIBUTES = {"rotation": slice(0, 4), "scale": slice(4, 7), "opacity": slice(7, 8), "color": slice(8, 11)}


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


def test_bits_gradient_equals_finite_differences() -> None:
    torch.manual_seed(0)
    residual = (torch.randn(30, 3) * 4).double().requires_grad_()
    mu = torch.tensor([0.3, -1.0, 0.0]).double().requires_grad_()
    sigma = torch.tensor([0.4, 1.0, 5.0]).double().requires_grad_()
    assert torch.autograd.gradcheck(bits_of_residual, (residual, mu, sigma), eps=1e-6, atol=1e-5)


def test_bits_have_finite_gradients_far_out() -> None:
    residual = torch.tensor([0.0, 5.0, 60.0, -400.0, 1e7], requires_grad=True)
    mu, sigma = torch.zeros((), requires_grad=True), torch.ones((), requires_grad=True)
    bits = bits_of_residual(residual, mu, sigma)
    bits.sum().backward()
    assert torch.isfinite(bits).all()
    assert torch.isfinite(residual.grad).all()
    assert torch.isfinite(sigma.grad)
    assert residual.grad[2] > 0 > residual.grad[3], "the loss pulls residuals toward the mean"


def test_learned_entropy_reaches_that_of_the_data() -> None:
    """Fitted to Gaussian residuals of deviation 3 steps, the bits equal a Gaussian's differential entropy."""
    torch.manual_seed(0)
    before = torch.zeros(5000, 11)
    current = 1.5 + 3 * torch.randn(5000, 11)
    loss = ResidualEntropy(before, torch.ones(11), ATTRIBUTES)
    adam = torch.optim.Adam(loss.parameters(), lr=0.05)
    for seed in range(200):
        adam.zero_grad()
        loss(current, seed).backward()
        adam.step()
    assert torch.allclose(loss.mu.detach(), torch.full((4,), 1.5), atol=0.2)
    exact = 11 * 0.5 * math.log2(2 * math.pi * math.e * (9 + 1 / 12))
    assert loss(current, 1000).item() == pytest.approx(exact, rel=0.01)


def test_entropy_sums_elements_and_averages_splats() -> None:
    before = torch.randn(50, 20)
    steps = torch.rand(20) + 0.5
    current = before + torch.randn(50, 20)
    total = ResidualEntropy(before, steps, {**ATTRIBUTES, "sh": slice(11, 20)})(current, 3)
    noise = uniform(1000, 3, torch.float32).reshape(50, 20) - 0.5
    bits = bits_of_residual((current - before) / steps + noise, torch.zeros(()), torch.ones(()))
    assert total.item() == pytest.approx(bits.sum().item() / 50, rel=1e-4)


def test_temporal_loss_is_the_sum_over_the_plane() -> None:
    before = torch.cat([torch.zeros(10, 3), torch.ones(10, 3)], 1)
    now = torch.cat([torch.full((10, 3), -0.5), torch.full((10, 3), 3.0)], 1)
    assert temporal_loss(now, before, 64).item() == pytest.approx((15 + 60) / 64)


def test_huber_is_quadratic_inside_and_linear_outside() -> None:
    steps = torch.tensor([0.1, 0.2])
    before = torch.zeros(2, 2)
    now = torch.tensor([[0.05, 0.1], [1.0, -1.0]])
    # width: twice the step, 0.2 and 0.4
    inside = 0.05**2 / 2 / 0.2 + 0.1**2 / 2 / 0.4
    outside = (1.0 - 0.1) + (1.0 - 0.2)
    assert temporal_loss(now, before, 16, steps, huber=2.0).item() == pytest.approx((inside + outside) / 16)
    # with a vanishing width it is the L1
    narrow = temporal_loss(now, before, 16, steps, huber=1e-6).item()
    assert narrow == pytest.approx(temporal_loss(now, before, 16).item(), rel=1e-5)


def test_simulated_rounding_is_the_bakers_and_passes_gradients() -> None:
    from studio.stream.quantize import LEVELS_8, dequantize, quantize

    generator = torch.Generator().manual_seed(4)
    n = 500
    splats = Gaussians(
        torch.rand(n, 3, generator=generator),
        torch.randn(n, 4, generator=generator),
        torch.randn(n, 3, generator=generator),
        torch.randn(n, generator=generator),
        torch.randn(n, 4, 3, generator=generator),
    )
    splats.log_scales.requires_grad_(True)
    coding = coding_of("planes", splats)
    values = coding.coded_values(splats)
    drawn = simulate_quantization(coding, splats, values, coding.quantizer(values))
    for column in range(3):
        plain = splats.log_scales[:, column].detach().numpy()
        lowest, highest = float(plain.min()), float(plain.max())
        stored = dequantize(quantize(plain, lowest, highest, LEVELS_8), lowest, highest, LEVELS_8)
        assert np.abs(drawn.log_scales[:, column].detach().numpy() - stored).max() < 1e-5
    assert drawn.sh.shape == splats.sh.shape
    drawn.log_scales.sum().backward()
    assert torch.equal(splats.log_scales.grad, torch.ones(n, 3))
