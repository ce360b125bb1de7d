"""The Triton kernels of the motion field against its definition. `test_triton_field.py` runs this file with
TRITON_INTERPRET=1.
"""

from __future__ import annotations

import pytest
import torch

from studio.training.hashgrid import Corners
from studio.training.motion import MotionField
from studio.training.triton_field import motion_field_triton
from tests.studio.training.test_motion import field_and_means

SIZES = {
    "demo": {"hash_levels": 6},
    "paper": {"hash_log2_size": 10},
    "smallest": {"hash_levels": 1, "hash_features": 1, "mlp_width": 3, "mlp_layers": 1, "hash_log2_size": 4},
    "deep": {"hash_levels": 3, "hash_features": 3, "mlp_width": 20, "mlp_layers": 8, "hash_log2_size": 6},
    "wide": {"hash_levels": 2, "hash_features": 16, "mlp_width": 130, "mlp_layers": 2},
    "long": {"hash_levels": 32, "hash_features": 5, "hash_log2_size": 5, "hash_growth": 1.1, "mlp_layers": 1},
}


def results(field: MotionField, corners: Corners, triton: bool) -> list[torch.Tensor]:
    """Outputs, and gradients of the table, the weights and the biases."""
    leaves = list(field.parameters())
    upstream = torch.randn(corners.positions, 3, generator=torch.Generator().manual_seed(1)).to(leaves[0])
    moved = motion_field_triton(corners, field._side, leaves[0], leaves[1:]) if triton else field.forward_torch(corners)
    return [moved.detach(), *torch.autograd.grad(moved, leaves, upstream)]


@pytest.mark.parametrize("sizes", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("count", [1, 700])
def test_outputs_and_gradients(sizes: dict[str, int], count: int) -> None:
    field, means = field_and_means(torch.float32, count, **sizes)
    exact, _ = field_and_means(torch.float64, count, **sizes)
    exact.load_state_dict({name: value.double() for name, value in field.state_dict().items()})
    corners = field.corners(means)
    usual, found = results(field, corners, False), results(field, corners, True)
    right = results(exact, Corners(corners.rows, corners.weights.double(), corners.level_rows), False)
    assert len(found) == 2 + 2 * (int(sizes.get("mlp_layers", 2)) + 1)
    for value, reference, expected in zip(found, usual, right, strict=True):
        assert value.dtype == torch.float32
        assert value.shape == reference.shape
        error, usual_error = ((one.double() - expected).norm() for one in (value, reference))
        assert float(error) <= max(4 * float(usual_error), 2e-6 * float(expected.norm()))
        assert count == 1 or float(expected.norm()) > 0, "something is compared"


def test_a_row_that_all_read() -> None:
    """All positions are in one cell, whose eight rows take several passes to sum."""
    sizes = {"hash_levels": 1, "hash_base_resolution": 1, "mlp_width": 8, "mlp_layers": 1}
    field, means = field_and_means(torch.float32, 5000, **sizes)
    corners = field.corners(means)
    assert len(corners.passes.pieces) == 3
    usual, found = results(field, corners, False), results(field, corners, True)
    for value, reference in zip(found, usual, strict=True):
        torch.testing.assert_close(value, reference, rtol=2e-4, atol=1e-3)


def test_no_positions() -> None:
    field, means = field_and_means(torch.float32, 4, hash_levels=2)
    found = results(field, field.corners(means[:0]), True)
    assert found[0].shape == (0, 3)
    assert all(not gradient.any() for gradient in found[1:])


def test_what_is_not_a_number_stays_so() -> None:
    """Or training that diverges would not be noticed."""
    field, means = field_and_means(torch.float32, 5, hash_levels=2)
    with torch.no_grad():
        next(iter(field.mlp.parameters()))[0, 0] = torch.nan
    assert all(results(field, field.corners(means), triton)[0].isnan().all() for triton in (False, True))
