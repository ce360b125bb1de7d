"""The fused photometric loss against its definition in torch."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from tests.studio.rasterizer.conftest import assert_same_by_any_threads
from tests.support.errors import refuses
from v3studio.studio.training.photometric import photometric_loss, photometric_loss_torch


def pair(height: int, width: int) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(height * 1000 + width)
    target = torch.rand(height, width, 3, generator=generator)
    image = (target + 0.2 * torch.randn(target.shape, generator=generator)).requires_grad_()
    return image, target


def both(
    image: Tensor, target: Tensor, weight: float, loss_of: Callable[..., Tensor] = photometric_loss
) -> tuple[Tensor, ...]:
    loss = loss_of(image, target, weight)
    assert loss.dtype == image.dtype
    (gradient,) = torch.autograd.grad(3 * loss, image)
    exact = image.detach().double().requires_grad_()
    true_loss = photometric_loss_torch(exact, target.double(), weight)
    (true_gradient,) = torch.autograd.grad(3 * true_loss, exact)
    return loss.detach().double(), gradient.double(), true_loss.detach(), true_gradient


@pytest.mark.usefixtures("instruction_set")
@pytest.mark.parametrize(
    ("size", "weight"),
    [((1, 1), 0.2), ((1, 40), 0.2), ((40, 1), 1.0), ((11, 11), 0.0), ((17, 130), 1.0), ((135, 64), 0.2)],
)
def test_value_and_gradient(size: tuple[int, int], weight: float) -> None:
    loss, gradient, true_loss, true_gradient = both(*pair(*size), weight)
    torch.testing.assert_close(loss, true_loss, rtol=1e-5, atol=1e-7)
    assert (gradient - true_gradient).norm() <= 1e-5 * true_gradient.norm()


def test_flat_images_have_no_difference() -> None:
    flat = torch.full((20, 30, 3), 0.4, requires_grad=True)
    loss = photometric_loss(flat, flat.detach().clone())
    loss.backward()
    assert abs(loss.item()) < 1e-6
    assert flat.grad.abs().max() < 1e-6


def test_no_gradient_for_the_target_or_where_none_is_required() -> None:
    image, target = pair(30, 20)
    assert not photometric_loss(image.detach(), target).requires_grad
    torch.testing.assert_close(photometric_loss(image.detach(), target), photometric_loss(image, target).detach())


def test_same_bits_for_any_number_of_threads() -> None:
    image, target = pair(203, 151)
    assert_same_by_any_threads(lambda: both(image, target, 0.2)[:2])


def test_bad_arguments() -> None:
    image, target = pair(8, 9)
    with refuses("metrics.image_shape", value=((8, 9, 3), (7, 9, 3))):
        photometric_loss(image, target[1:])
    with refuses("settings.invalid_value", value=2, setting="train.dssim_weight"):
        photometric_loss(image, target, 2)
    with refuses("metrics.image_shape", value=((0, 9, 3), (0, 9, 3))):
        photometric_loss(image[:0], target[:0])
