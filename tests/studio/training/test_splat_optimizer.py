"""Splats keep their Adam moments when others are added and removed."""

import torch

from tests.studio.rasterizer.conftest import make_splats
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.training.keyframe import prune
from v3studio.studio.training.settings import LearningRates
from v3studio.studio.training.splat_optimizer import SplatOptimizer


def splats(count: int) -> Gaussians:
    return make_splats(count, degree=1, seed=count).to(torch.float32)


def drive(optimizer: SplatOptimizer, weights: torch.Tensor, steps: int) -> None:
    for _ in range(steps):
        loss = sum(tensor.reshape(len(weights), -1).sum(1) for _, tensor in optimizer.gaussians.items())
        (loss * weights).sum().backward()
        optimizer.step()


def assert_close(one: Gaussians, other: Gaussians) -> None:
    for name, value in one.items():
        assert torch.allclose(value, getattr(other, name), atol=1e-6), name


def test_kept_splats_train_as_if_alone() -> None:
    everything = splats(12)
    weights = torch.linspace(-1, 1, 12)
    kept = torch.tensor([1, 4, 7])
    both, alone = (SplatOptimizer(one, LearningRates(), 1.0) for one in (everything, everything[kept]))
    drive(both, weights, 3)
    drive(alone, weights[kept], 3)
    both.keep(kept)
    drive(both, weights[kept], 3)
    drive(alone, weights[kept], 3)
    assert_close(both.gaussians, alone.gaussians)


def test_appended_splats_do_not_affect_the_others() -> None:
    grown, plain = (SplatOptimizer(splats(5), LearningRates(), 1.0) for _ in range(2))
    drive(grown, torch.ones(5), 2)
    grown.append(splats(3))
    assert len(grown) == 8
    drive(grown, torch.ones(8), 2)
    drive(plain, torch.ones(5), 4)
    assert_close(grown.gaussians[:5], plain.gaussians)


def test_pruning_removes_the_splats_with_the_lowest_importance_and_keeps_the_order() -> None:
    start = splats(100)
    optimizer = SplatOptimizer(start, LearningRates(), 1.0)
    importance = torch.rand(100, generator=torch.Generator().manual_seed(5))
    prune(optimizer, importance, 30)
    kept = [index for index in range(100) if importance[index] >= importance.sort().values[30]]
    assert torch.equal(optimizer.gaussians.means.detach(), start.means[kept])
