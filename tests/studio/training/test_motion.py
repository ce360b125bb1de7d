"""The predicted motion, and the kernel of the motion field against its PyTorch definition."""

import pytest
import torch

from tests.studio.rasterizer.conftest import assert_same_by_any_threads
from tests.studio.training.test_group import SHIFT, ball
from v3studio.studio.training.hashgrid import HashGrid
from v3studio.studio.training.motion import MotionField, predicted_means

SIZES = {
    "demo": {"levels": 6},
    "deep": {"levels": 3, "features": 3, "log2_size": 6, "width": 20, "layers": 3},
    "shallow": {"levels": 1, "features": 16, "width": 17, "layers": 1},
}


def field_and_means(dtype, count, width=64, layers=2, **grid) -> tuple[MotionField, torch.Tensor]:
    random = torch.Generator().manual_seed(3)
    means = torch.rand(count, 3, generator=random, dtype=torch.float64) * torch.tensor([1.0, 2.0, 0.5])
    hash_grid = HashGrid(**{"log2_size": 9, **grid}, generator=random)  # type: ignore[arg-type]
    field = MotionField(means.amin(0), means.amax(0), hash_grid, width, layers, random).to(dtype)
    with torch.no_grad():  # as after some training; the first field is zero
        for parameter in field.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=random) * 0.3)
    return field, means.to(dtype)


def both(field: MotionField, means: torch.Tensor) -> list[list[torch.Tensor]]:
    """Outputs and gradients of the kernel and of the definition."""
    corners = field.corners(means)
    upstream = torch.randn(len(means), 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64).to(means)
    results = []
    for function in (field.forward, field.forward_torch):
        moved = function(corners)
        gradients = torch.autograd.grad(moved, list(field.parameters()), upstream)
        results.append([moved.detach(), *gradients])
    return results


@pytest.mark.parametrize("sizes", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("count", [1, 47, 1601])
def test_the_kernel_equals_the_definition(sizes: dict[str, int], count: int) -> None:
    for fused, expected in zip(*both(*field_and_means(torch.float64, count, **sizes)), strict=True):
        assert torch.allclose(fused, expected, rtol=1e-10, atol=1e-10)


@pytest.mark.usefixtures("instruction_set")
def test_float32_is_as_accurate_as_the_definition() -> None:
    exact = both(*field_and_means(torch.float64, 1601, levels=6))[1]
    fused, plain = both(*field_and_means(torch.float32, 1601, levels=6))
    for value, reference, right in zip(fused, plain, exact, strict=True):
        error, usual = ((one - right).norm() / right.norm() for one in (value.double(), reference.double()))
        assert float(error) < max(4 * float(usual), 2e-6)


def test_any_number_of_threads_gives_the_same_bits() -> None:
    field, means = field_and_means(torch.float32, 5000, levels=6)
    assert_same_by_any_threads(lambda: both(field, means)[0])


def test_the_prediction_continues_velocity_and_part_of_the_acceleration() -> None:
    third, older, previous = (ball(place * SHIFT) for place in (0, 1, 3))
    assert predicted_means(previous, None, None, 0.5) is previous.means
    for earlier, acceleration, shift in ((third, 0.5, 2.5), (third, 0.0, 2.0), (None, 0.5, 2.0)):
        moved = predicted_means(previous, older, earlier, acceleration)
        assert torch.allclose(moved, previous.means + shift * SHIFT, atol=1e-6)  # moved by 1, then by 2
