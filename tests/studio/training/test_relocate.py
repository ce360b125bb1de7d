"""Relocation: copies of a splat together look like the original."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from studio.cameras import Camera
from studio.gaussians import Gaussians
from studio.rasterizer import rasterize
from studio.training.relocate import add_noise, grow, relocate_dead, shared_opacity_and_scale
from studio.training.settings import LearningRates
from studio.training.splat_optimizer import SplatOptimizer
from tests.support.splats import round_splats, same_splats

CAMERA = Camera("a", 64, 64, np.array([[60.0, 0, 32], [0, 60.0, 32], [0, 0, 1]]), np.eye(4))


def splats(opacities: list[float]) -> Gaussians:
    count = len(opacities)
    means = torch.stack([torch.linspace(-0.6, 0.6, count), torch.zeros(count), torch.full((count,), 2.0)], 1)
    return replace(round_splats(means, -1.6), logit_opacities=torch.logit(torch.tensor(opacities)))


# few enough copies that each stays above the alpha threshold of 1/255
@pytest.mark.parametrize(("opacity", "copies"), [(0.2, 1), (0.2, 3), (0.6, 2), (0.6, 5), (0.95, 17)])
def test_copies_render_like_the_original(copies: int, opacity: float) -> None:
    one = splats([opacity])
    new, factor = shared_opacity_and_scale(torch.tensor([opacity]), torch.tensor([copies]))
    # N copies on top of each other have the transmittance of the original
    assert float((1 - new) ** copies) == pytest.approx(1 - opacity, rel=1e-5)
    many = one[torch.zeros(copies, dtype=torch.long)]
    many.log_scales, many.logit_opacities = many.log_scales + factor.log(), torch.logit(new).repeat(copies)
    before, after = rasterize(one, CAMERA).alpha, rasterize(many, CAMERA).alpha
    # equation 9 preserves the integral along a line, not each pixel
    assert float(after[32].sum()) == pytest.approx(float(before[32].sum()), rel=0.05)
    assert float(after.max()) == pytest.approx(float(before.max()), rel=0.02)


def test_dead_splats_move_to_live_ones() -> None:
    optimizer = SplatOptimizer(splats([0.001, 0.5, 0.002, 0.9, 0.001]), LearningRates(), 1.0)
    places = optimizer.gaussians.means.detach().clone()
    relocate_dead(optimizer, torch.Generator().manual_seed(0))
    after = optimizer.gaussians.detach()
    assert len(after) == 5
    assert float(after.opacities.min()) > 0.005
    assert float(torch.cdist(after.means, places[[1, 3]]).amin(1).max()) == 0
    relocate_dead(optimizer, torch.Generator())
    assert same_splats(optimizer.gaussians, after), "no splat is dead now"


def test_growth_ends_at_the_budget_and_new_splats_train() -> None:
    optimizer = SplatOptimizer(splats([0.5] * 100), LearningRates(), 1.0)
    optimizer.gaussians.opacities.sum().backward()
    optimizer.step()
    generator = torch.Generator().manual_seed(1)
    for budget, count in ((1000, 105), (107, 107), (107, 107)):
        grow(optimizer, budget, generator)
        assert len(optimizer) == count
    optimizer.gaussians.opacities.sum().backward()
    optimizer.step()
    assert torch.isfinite(optimizer.gaussians.logit_opacities).all()


@pytest.mark.parametrize(("opacity", "power"), [(0.005, 0), (0.025, 2), (1e-6, -0.5)])
def test_the_noise_is_as_strong_as_in_the_paper(opacity: float, power: float) -> None:
    """Equation 8 of Kheradmand et al. 2024, with their rate of 5e5: covariance times normal numbers."""
    start = splats([opacity] * 4000)
    start.log_scales = torch.log(torch.tensor([0.5, 0.2, 0.1])).repeat(4000, 1)
    optimizer = SplatOptimizer(start, LearningRates(means=1e-6), 1.0)
    add_noise(optimizer, torch.Generator().manual_seed(3))
    moved = (optimizer.gaussians.means.detach() - start.means).numpy()
    expected = 5e5 * 1e-6 / (1 + np.exp(power)) * np.array([0.5, 0.2, 0.1]) ** 2
    np.testing.assert_allclose(moved.std(axis=0), expected, rtol=0.05)
    assert (np.abs(moved.mean(axis=0)) < 0.1 * expected).all()
