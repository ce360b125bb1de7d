"""Adam without PyTorch's compiler."""

import sys
from types import SimpleNamespace

import pytest
import torch

from v3studio.studio.training.adam import Adam, ParameterGroup


def values() -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    return [torch.randn(size, generator=generator) for size in ((33, 3), (33,), (7, 1, 3))]


def test_steps_are_those_of_pytorch_to_the_last_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    # PyTorch's Adam asks its compiler to leave its methods alone, and importing that takes seconds
    compiler = SimpleNamespace(disable=lambda method, *_, **__: method, graph_break=lambda: None)
    monkeypatch.setitem(sys.modules, "torch._dynamo", compiler)
    ours, theirs = ([value.clone().requires_grad_() for value in values()] for _ in range(2))
    rates = (1e-2, 3e-3)
    adam = Adam([ParameterGroup(ours[:2], rates[0]), ParameterGroup(ours[2:], rates[1])], betas=(0.9, 0.99), eps=1e-15)
    groups = [{"params": theirs[:2], "lr": rates[0]}, {"params": theirs[2:], "lr": rates[1]}]
    expected = torch.optim.Adam(groups, betas=(0.9, 0.99), eps=1e-15, fused=True)
    generator = torch.Generator().manual_seed(2)
    for step in range(5):
        for group, reference, rate in zip(adam.groups, expected.param_groups, rates, strict=True):
            group.rate = reference["lr"] = rate * 0.5**step
        for index, (one, other) in enumerate(zip(ours, theirs, strict=True)):
            one.grad = torch.randn(one.shape, generator=generator) if (step, index) != (0, 1) else None
            other.grad = None if one.grad is None else one.grad.clone()
        adam.step()
        expected.step()
    for one, other in zip(ours, theirs, strict=True):
        assert torch.equal(one, other)
        assert set(adam.state[one]) == set(expected.state[other])
        assert all(torch.equal(value, expected.state[other][name]) for name, value in adam.state[one].items())
    adam.zero_grad()
    assert all(leaf.grad is None for leaf in ours)
