"""The Triton kernel of the loss on coded values against its definition. `test_interpreted.py` runs this file with
TRITON_INTERPRET=1.
"""

import pytest
import torch

from tests.studio.training.test_coded_loss import in_double, make
from v3studio.studio.training.coded_loss import CodedLoss
from v3studio.studio.training.triton.coded import coded_loss_triton


def results(loss: CodedLoss, now: torch.Tensor, triton: bool, seed: int) -> list[torch.Tensor]:
    leaf = now.clone().requires_grad_()
    total, bits = coded_loss_triton(loss, leaf, seed) if triton else loss.forward_torch(leaf, seed)
    leaves = [leaf, loss.mu, loss.log_sigma] if loss.entropy_weight else [leaf]
    return [total.detach(), bits, *torch.autograd.grad(2 * total, leaves)]


@pytest.mark.parametrize(
    ("count", "spread", "weights", "seed"),
    [
        (1, 0.3, (0.3, 0.2), 1),
        (150, 5.0, (0.3, 0.2), 2**32 - 1),
        (150, 400.0, (0.3, 0.2), 1),
        (150, 0.3, (0.0, 0.2), 1),
        (150, 0.3, (0.3, 0.0), 1),
    ],
)
def test_value_and_gradients(count: int, spread: float, weights: tuple[float, float], seed: int) -> None:
    loss, now = make(torch.float32, count, spread, weights)
    right = results(in_double(loss), now.double(), False, seed)
    found, usual = results(loss, now, True, seed), results(loss, now, False, seed)
    for value, reference, expected in zip(found, usual, right, strict=True):
        assert value.dtype == torch.float32
        error, usual_error = ((one.double() - expected).norm() for one in (value, reference))
        assert float(error) <= max(2 * float(usual_error), 1e-5 * float(expected.norm()) + 1e-12)


def test_values_that_are_not_contiguous() -> None:
    loss, now = make(torch.float32, 30, 2.0, (0.3, 0.2))
    turned = now.T.contiguous().T
    assert not turned.is_contiguous()
    for one, other in zip(results(loss, turned, True, 5), results(loss, now, True, 5), strict=True):
        assert torch.equal(one, other)
