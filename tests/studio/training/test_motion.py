"""The kernel of the motion field against its PyTorch definition."""

import pytest
import torch

from studio.rasterizer import set_kernel_threads
from studio.training.motion import MotionField
from studio.training.settings import TrainSettings

SIZES = {
    "demo": {"hash_levels": 6},
    "deep": {"hash_levels": 3, "hash_features": 3, "mlp_width": 20, "mlp_layers": 3, "hash_log2_size": 6},
    "shallow": {"hash_levels": 1, "hash_features": 16, "mlp_width": 17, "mlp_layers": 1},
}


def field_and_means(dtype: torch.dtype, count: int, **sizes: int) -> tuple[MotionField, torch.Tensor]:
    random = torch.Generator().manual_seed(3)
    means = torch.rand(count, 3, generator=random, dtype=torch.float64) * torch.tensor([1.0, 2.0, 0.5])
    settings = TrainSettings(**{"hash_log2_size": 9, **sizes})
    field = MotionField(means.amin(0), means.amax(0), settings, random).to(dtype)
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
    exact = both(*field_and_means(torch.float64, 1601, hash_levels=6))[1]
    fused, plain = both(*field_and_means(torch.float32, 1601, hash_levels=6))
    for value, reference, right in zip(fused, plain, exact, strict=True):
        error, usual = ((one - right).norm() / right.norm() for one in (value.double(), reference.double()))
        assert float(error) < max(4 * float(usual), 2e-6)


def test_any_number_of_threads_gives_the_same_bits() -> None:
    field, means = field_and_means(torch.float32, 5000, hash_levels=6)
    try:
        results = []
        for threads in (1, 3):
            set_kernel_threads(threads)
            results.append(both(field, means)[0])
    finally:
        set_kernel_threads(None)
    assert all(torch.equal(one, other) for one, other in zip(*results, strict=True))
