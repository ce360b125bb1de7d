"""Dropout by opacity: the kernel against its definition, and what the definition promises."""

import pytest
import torch

from v3studio.studio.training.dropout import DROPPED_LOGIT, drop_splats, drop_splats_torch


@pytest.mark.usefixtures("instruction_set")
@pytest.mark.parametrize(("dtype", "error"), [(torch.float32, 2e-6), (torch.float64, 1e-12)])
def test_the_kernel_equals_the_definition(dtype: torch.dtype, error: float) -> None:
    logits = torch.cat([torch.linspace(-40, 40, 4001, dtype=dtype), torch.tensor([5.3, -13.0], dtype=dtype)])
    results = []
    for function, source in ((drop_splats, logits), (drop_splats_torch, logits.double())):
        leaf = source.clone().requires_grad_()
        drawn = function(leaf, 0.35, 77)
        drawn.mul(torch.linspace(1, 2, len(leaf), dtype=source.dtype)).sum().backward()
        results.append((drawn.detach().double(), leaf.grad.double()))
    (drawn, slope), (expected, expected_slope) = results
    assert torch.equal(drawn == DROPPED_LOGIT, expected == DROPPED_LOGIT)
    assert float(((drawn - expected).abs() / (1 + expected.abs())).max()) < error
    edge = (expected - torch.logit(torch.tensor(0.995, dtype=torch.float64))).abs() < 1e-4  # of the clamp
    assert float(((slope - expected_slope).abs() / (1 + expected_slope.abs()))[~edge].max()) < 10 * error
