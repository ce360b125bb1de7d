"""Splats keep their Adam moments when others are added and removed."""

import torch

from studio.gaussians import Gaussians
from studio.training.keyframe import prune
from studio.training.settings import LearningRates
from studio.training.splat_optimizer import SplatOptimizer


def splats(count: int, degree: int = 1) -> Gaussians:
    torch.manual_seed(count)
    return Gaussians(
        torch.randn(count, 3),
        torch.randn(count, 4),
        torch.full((count, 3), -3.0),
        torch.randn(count),
        torch.randn(count, (degree + 1) ** 2, 3),
    )


def drive(optimizer: SplatOptimizer, weights: torch.Tensor, steps: int) -> None:
    for _ in range(steps):
        gaussians = optimizer.gaussians
        loss = sum(
            (tensor.flatten(1) if tensor.ndim > 1 else tensor[:, None]).sum(1) for _, tensor in gaussians.items()
        )
        (loss * weights).sum().backward()
        optimizer.step()


def test_kept_splats_train_as_if_alone() -> None:
    everything = splats(12)
    weights = torch.linspace(-1, 1, 12)
    kept = torch.tensor([1, 4, 7])
    both = SplatOptimizer(everything, LearningRates(), 1.0)
    alone = SplatOptimizer(everything[kept], LearningRates(), 1.0)
    drive(both, weights, 3)
    drive(alone, weights[kept], 3)
    both.keep(kept)
    drive(both, weights[kept], 3)
    drive(alone, weights[kept], 3)
    for (name, one), (_, other) in zip(both.gaussians.items(), alone.gaussians.items(), strict=True):
        assert torch.allclose(one, other, atol=1e-6), name


def test_appended_splats_do_not_affect_the_others() -> None:
    first, extra = splats(5), splats(3)
    grown = SplatOptimizer(first, LearningRates(), 1.0)
    plain = SplatOptimizer(first, LearningRates(), 1.0)
    weights = torch.ones(5)
    drive(grown, weights, 2)
    drive(plain, weights, 2)
    grown.append(extra)
    assert len(grown) == 8
    drive(grown, torch.ones(8), 2)
    drive(plain, weights, 2)
    for (name, one), (_, other) in zip(grown.gaussians[:5].items(), plain.gaussians.items(), strict=True):
        assert torch.allclose(one, other, atol=1e-6), name


def test_pruning_removes_the_splats_with_the_lowest_importance_and_keeps_the_order() -> None:
    start = splats(100)
    optimizer = SplatOptimizer(start, LearningRates(), 1.0)
    importance = torch.rand(100, generator=torch.Generator().manual_seed(5))
    prune(optimizer, importance, 30)
    kept = [index for index in range(100) if importance[index] >= importance.sort().values[30]]
    assert torch.equal(optimizer.gaussians.means.detach(), start.means[kept])
