"""The Triton kernels of the motion field against its definition. `test_interpreted.py` runs this file with
TRITON_INTERPRET=1.
"""

import pytest
import torch

from tests.studio.training.test_motion import field_and_means
from v3studio.studio.training import hashgrid
from v3studio.studio.training.hashgrid import Corners
from v3studio.studio.training.motion import MotionField
from v3studio.studio.training.triton.field import motion_field_triton

SIZES = {
    "demo": {"levels": 6},
    "smallest": {"levels": 1, "features": 1, "width": 3, "layers": 1, "log2_size": 4},
    "deep": {"levels": 3, "features": 3, "width": 20, "layers": 4, "log2_size": 6},
    "wide": {"levels": 2, "features": 16, "width": 70, "layers": 2},
}


def results(field: MotionField, corners: Corners, triton: bool) -> list[torch.Tensor]:
    """Outputs, and gradients of the table, the weights and the biases."""
    leaves = list(field.parameters())
    upstream = torch.randn(corners.positions, 3, generator=torch.Generator().manual_seed(1)).to(leaves[0])
    moved = motion_field_triton(corners, field.side, leaves[0], leaves[1:]) if triton else field.forward_torch(corners)
    return [moved.detach(), *torch.autograd.grad(moved, leaves, upstream)]


@pytest.mark.parametrize(("name", "count"), [("smallest", 1), *((name, 130) for name in ("demo", "deep", "wide"))])
def test_outputs_and_gradients(name: str, count: int) -> None:
    sizes = SIZES[name]
    field, means = field_and_means(torch.float32, count, **sizes)
    exact, _ = field_and_means(torch.float64, count, **sizes)
    exact.load_state_dict({name: value.double() for name, value in field.state_dict().items()})
    corners = field.corners(means)
    usual, found = results(field, corners, False), results(field, corners, True)
    right = results(exact, Corners(corners.rows, corners.weights.double(), corners.level_rows), False)
    assert len(found) == 2 + 2 * (int(sizes.get("layers", 2)) + 1)
    for value, reference, expected in zip(found, usual, right, strict=True):
        assert value.dtype == torch.float32
        assert value.shape == reference.shape
        error, usual_error = ((one.double() - expected).norm() for one in (value, reference))
        assert float(error) <= max(4 * float(usual_error), 2e-6 * float(expected.norm()))
        assert count == 1 or float(expected.norm()) > 0, "something is compared"


def test_a_row_that_all_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """All positions are in one cell, whose eight rows take several passes to sum."""
    monkeypatch.setattr(hashgrid, "PIECE", 8)
    sizes = {"levels": 1, "base_resolution": 1, "width": 8, "layers": 1}
    field, means = field_and_means(torch.float32, 400, **sizes)
    corners = field.corners(means)
    assert len(corners.passes.pieces) == 3
    usual, found = results(field, corners, False), results(field, corners, True)
    for value, reference in zip(found, usual, strict=True):
        torch.testing.assert_close(value, reference, rtol=2e-4, atol=1e-3)


def test_no_positions() -> None:
    field, means = field_and_means(torch.float32, 4, levels=2)
    found = results(field, field.corners(means[:0]), True)
    assert found[0].shape == (0, 3)
    assert all(not gradient.any() for gradient in found[1:])


def test_what_is_not_a_number_stays_so() -> None:
    """Or training that diverges would not be noticed."""
    field, means = field_and_means(torch.float32, 5, levels=2)
    with torch.no_grad():
        next(iter(field.mlp.parameters()))[0, 0] = torch.nan
    assert all(results(field, field.corners(means), triton)[0].isnan().all() for triton in (False, True))
