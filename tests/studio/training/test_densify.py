"""Density control of 3DGS: which splats are cloned, split and removed, and at which steps."""

from __future__ import annotations

import math

import pytest
import torch

from studio.gaussians import Gaussians
from studio.training import TrainSettings
from studio.training.densify import DensityControl
from studio.training.splat_optimizer import SplatOptimizer

EXTENT = 2.0
PICTURE = (100, 50)


def scene(sizes: list[float], opacity: float = 0.5) -> SplatOptimizer:
    """Splats along x with these sizes."""
    count = len(sizes)
    means = torch.zeros(count, 3)
    means[:, 0] = torch.arange(count)
    quats = torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1)
    scales = torch.tensor(sizes).log()[:, None].repeat(1, 3)
    logits = torch.full((count,), math.log(opacity / (1 - opacity)))
    settings = TrainSettings()
    return SplatOptimizer(Gaussians(means, quats, scales, logits, torch.zeros(count, 1, 3)), settings.rates, EXTENT)


def observed(control: DensityControl, gradients: list[float], radii: list[int] | None = None) -> None:
    """One step in which the 2D means had these gradients along x, in NDC units."""
    screen = torch.zeros(len(gradients), 2)
    screen[:, 0] = torch.tensor(gradients) / (PICTURE[0] / 2)
    control.observe(screen, torch.tensor(radii or [3] * len(gradients)), PICTURE, PICTURE)


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(1)


def settings(**values: object) -> TrainSettings:
    return TrainSettings(**{"densify_gradient": 0.1, "densify_max_splats": 100, **values})  # type: ignore[arg-type]


def test_small_splats_are_cloned_and_large_ones_split() -> None:
    small, large = 0.009 * EXTENT, 0.011 * EXTENT  # percent_dense is 0.01
    optimizer = scene([small, large, small, large])
    control = DensityControl(4, EXTENT, settings(), torch.device("cpu"))
    observed(control, [0.2, 0.2, 0.05, 0.05])
    control.densify(optimizer, generator(), remove_huge=False)
    after = optimizer.gaussians.detach()
    # 0 and its clone, 2 and 3 as they were, two halves of 1
    places = after.means[:, 0]
    assert (places == 0).sum() == 2
    assert (places == 1).sum() == 0
    assert (places == 2).sum() == (places == 3).sum() == 1
    near = (after.means - torch.tensor([1.0, 0, 0])).norm(dim=1) < 4 * math.sqrt(3) * large
    assert near.sum() == 2
    torch.testing.assert_close(after.scales[near], torch.full((2, 3), large / 1.6))
    assert not torch.equal(after.means[near][0], after.means[near][1])
    assert len(after) == 6


def test_the_budget_goes_to_the_largest_mean_gradients() -> None:
    optimizer = scene([0.001] * 5)
    control = DensityControl(5, EXTENT, settings(densify_max_splats=7), torch.device("cpu"))
    # splat 4 was drawn once of three times: its mean is 0.9, though its sum is the smallest but one
    observed(control, [0.3, 0.5, 0.4, 0.05, 0.9], [1, 1, 1, 1, 1])
    observed(control, [0.3, 0.5, 0.4, 0.05, 9.0], [1, 1, 1, 1, 0])
    observed(control, [0.3, 0.5, 0.4, 0.05, 9.0], [1, 1, 1, 1, 0])
    control.densify(optimizer, generator(), remove_huge=False)
    copies = torch.bincount(optimizer.gaussians.detach().means[:, 0].round().long(), minlength=5)
    assert copies.tolist() == [1, 2, 1, 1, 2]


def test_of_equal_gradients_the_first_splats_are_chosen() -> None:
    """On every processor and for any number of splats: results must be the same bytes."""
    count, budget = 4096, 1000
    optimizer = scene([0.001] * count)
    control = DensityControl(count, EXTENT, settings(densify_max_splats=count + budget), torch.device("cpu"))
    observed(control, [0.5] * count)
    control.densify(optimizer, generator(), remove_huge=False)
    clones = optimizer.gaussians.detach().means[count:, 0]
    assert clones.tolist() == list(range(budget))


def test_a_crop_counts_by_its_area() -> None:
    """The mean loss over a quarter of the picture has four times the gradients."""
    control = DensityControl(1, EXTENT, settings(), torch.device("cpu"))
    gradient = torch.tensor([[0.01, 0.0]])
    control.observe(gradient, torch.tensor([2]), (PICTURE[0] // 2, PICTURE[1] // 2), PICTURE)
    assert control.state()["gradients"].item() == pytest.approx(0.01 * PICTURE[0] / 2 / 4)
    assert control.state()["seen"].item() == 1


def test_faint_and_huge_splats_are_removed() -> None:
    optimizer = scene([0.001, 0.19 * EXTENT, 0.001])
    with torch.no_grad():
        optimizer.gaussians.logit_opacities[2] = math.log(0.004 / 0.996)
    control = DensityControl(3, EXTENT, settings(), torch.device("cpu"))
    control.densify(optimizer, generator(), remove_huge=False)
    assert optimizer.gaussians.detach().means[:, 0].tolist() == [0, 1]
    control.densify(optimizer, generator(), remove_huge=True)
    assert optimizer.gaussians.detach().means[:, 0].tolist() == [0]
    assert len(control.state()["seen"]) == 1


def test_when_it_densifies_and_resets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("studio.training.densify.RESET_EVERY", 15)
    chosen = settings(densify_from=10, densify_until=41, densify_every=10)
    optimizer = scene([0.001])
    control = DensityControl(1, EXTENT, chosen, torch.device("cpu"))
    grown, reset = [], []
    for iteration in range(1, 60):
        before = len(optimizer)
        observed(control, [1.0] * before)
        with torch.no_grad():
            optimizer.gaussians.logit_opacities.fill_(0.0)
        control.after_step(iteration, optimizer, generator())
        if len(optimizer) > before:
            grown.append(iteration)
        if optimizer.gaussians.opacities.max() < 0.4:
            reset.append(iteration)
            assert optimizer.gaussians.opacities.max().item() == pytest.approx(0.01)
    assert grown == [20, 30, 40]
    assert reset == [15, 30]  # none in the last quarter of densification
    assert len(optimizer) == 8
