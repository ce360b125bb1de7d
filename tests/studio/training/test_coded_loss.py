"""Entropy and temporal losses against scipy and closed forms, and their kernel against its PyTorch definition."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import log_ndtr

from tests.studio.rasterizer.conftest import assert_same_by_any_threads
from v3studio.studio.training.coded_loss import CodedLoss, bits_of_residual
from v3studio.studio.training.noise import uniform

ATTRIBUTES = {"rotation": slice(0, 4), "scale": slice(4, 7), "opacity": slice(7, 8), "color": slice(8, 11)}


def make(dtype: torch.dtype, count: int, spread: float, weights: tuple[float, float]) -> tuple[CodedLoss, torch.Tensor]:
    """A loss with learned distributions, and values whose residuals have a deviation of `spread` steps."""
    random = torch.Generator().manual_seed(0)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=random, dtype=torch.float64)

    steps = (0.02 * (0.5 * normal(11)).exp()).to(dtype)
    before = normal(count, 11).to(dtype)
    now = before + (spread * normal(count, 11)).to(dtype) * steps
    loss = CodedLoss(before, steps, ATTRIBUTES, 900, *weights).to(dtype)
    with torch.no_grad():
        loss.mu.copy_(0.3 * normal(4))
        loss.log_sigma.copy_(0.7 * normal(4))
    return loss, now


def in_double(loss: CodedLoss) -> CodedLoss:
    """The loss in float64, to which the definition is exact."""
    weights = loss.entropy_weight, loss.temporal_weight
    exact = CodedLoss(loss.before.double(), loss.steps.double(), ATTRIBUTES, 900, *weights).double()
    with torch.no_grad():
        exact.mu.copy_(loss.mu)
        exact.log_sigma.copy_(loss.log_sigma)
    return exact


def results(loss: CodedLoss, now: torch.Tensor, fused: bool) -> list[torch.Tensor]:
    leaf = now.clone().requires_grad_()
    total, bits = (loss if fused else loss.forward_torch)(leaf, 91)
    leaves = [leaf, loss.mu, loss.log_sigma] if loss.entropy_weight else [leaf]
    return [total.detach(), bits, *torch.autograd.grad(2 * total, leaves)]


@settings(max_examples=25, deadline=None)
@given(
    st.integers(1, 60),
    st.sampled_from([0.0, 0.3, 3.0, 60.0, 300.0]),
    st.sampled_from([(0.3, 0.2), (0.0, 0.2), (0.3, 0.0)]),
)
def test_the_kernel_equals_the_definition(count: int, spread: float, weights: tuple[float, float]) -> None:
    loss, now = make(torch.float64, count, spread, weights)
    for fused, expected in zip(results(loss, now, True), results(loss, now, False), strict=True):
        assert torch.allclose(fused, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.usefixtures("instruction_set")
@pytest.mark.parametrize("spread", [0.3, 5.0, 400.0])
def test_float32_is_as_accurate_as_the_definition(spread: float) -> None:
    loss, now = make(torch.float32, 3000, spread, (0.3, 0.2))
    right = results(in_double(loss), now.double(), False)
    for value, reference, expected in zip(results(loss, now, True), results(loss, now, False), right, strict=True):
        error, usual = ((one.double() - expected).norm() / expected.norm() for one in (value, reference))
        assert float(error) < max(2 * float(usual), 1e-5)


def test_any_number_of_threads_gives_the_same_bits() -> None:
    loss, now = make(torch.float32, 5000, 2.0, (0.3, 0.2))
    assert_same_by_any_threads(lambda: results(loss, now, True))


@pytest.mark.parametrize("sigma", [0.05, 0.3, 1.0, 7.0])
@pytest.mark.parametrize("mu", [0.0, -2.5])
def test_bits_equal_scipy(mu: float, sigma: float) -> None:
    residual = torch.cat([torch.linspace(-4, 4, 81) * max(sigma, 0.3) + mu, torch.tensor([mu + 9 * sigma])])
    values = residual.double().numpy()
    lower = -np.abs(values - mu)
    expected = -(
        log_ndtr((lower + 0.5) / sigma)
        + np.log1p(-np.exp(log_ndtr((lower - 0.5) / sigma) - log_ndtr((lower + 0.5) / sigma)))
    ) / math.log(2)
    bits = bits_of_residual(residual, torch.tensor(mu), torch.tensor(sigma))
    assert np.allclose(bits.numpy(), expected, rtol=2e-3, atol=2e-4)


def test_bits_gradient_equals_finite_differences() -> None:
    torch.manual_seed(0)
    residual = (torch.randn(30, 3) * 4).double()
    residual[0, 2] = 0.5  # an end of its interval is at mu
    residual.requires_grad_()
    mu = torch.tensor([0.3, -1.0, 0.0]).double().requires_grad_()
    sigma = torch.tensor([0.4, 1.0, 5.0]).double().requires_grad_()
    assert torch.autograd.gradcheck(bits_of_residual, (residual, mu, sigma), eps=1e-6, atol=1e-5)


def test_entropy_sums_elements_and_averages_splats() -> None:
    before = torch.randn(50, 20)
    steps = torch.rand(20) + 0.5
    current = before + torch.randn(50, 20)
    _, total = CodedLoss(before, steps, {**ATTRIBUTES, "sh": slice(11, 20)}, 64, 1.0, 0.0).forward_torch(current, 3)
    noise = uniform(1000, 3, torch.float32).reshape(50, 20) - 0.5
    bits = bits_of_residual((current - before) / steps + noise, torch.zeros(()), torch.ones(()))
    assert total.item() == pytest.approx(bits.sum().item() / 50, rel=1e-4)


def test_temporal_loss_is_the_sum_over_the_plane() -> None:
    before = torch.cat([torch.zeros(10, 3), torch.ones(10, 3)], 1)
    now = torch.cat([torch.full((10, 3), -0.5), torch.full((10, 3), 3.0)], 1)
    loss, _ = CodedLoss(before, torch.ones(6), {"scale": slice(0, 6)}, 64, 0.0, 1.0).forward_torch(now, 3)
    assert loss.item() == pytest.approx((15 + 60) / 64)
