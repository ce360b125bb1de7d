"""Density control: which splats are split and removed, and at which steps."""

import math
from dataclasses import replace

import pytest
import torch

from tests.studio.training.test_group import ball, views
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.training import TrainSettings
from v3studio.studio.training.densify import control_density, densify
from v3studio.studio.training.details import Detail
from v3studio.studio.training.splat_optimizer import SplatOptimizer
from v3studio.studio.training.step import Stepper
from v3studio.studio.training.views import TrainingView

EXTENT = 2.0


@pytest.fixture(scope="module")
def seen() -> list[TrainingView]:
    return views(torch.zeros(3))


def stepper(seen: list[TrainingView]) -> Stepper:
    return Stepper(seen, TrainSettings(), torch.Generator().manual_seed(1))


def optimizer_of(gaussians: Gaussians) -> SplatOptimizer:
    return SplatOptimizer(gaussians, TrainSettings().rates, EXTENT)


def wrong_where(wrong: torch.Tensor) -> Gaussians:
    """The ball with inverted colors where `wrong`."""
    gaussians = ball(torch.zeros(3))
    return replace(gaussians, sh=torch.where(wrong[:, None, None], -gaussians.sh, gaussians.sh))


def test_splats_are_split_where_views_agree_that_the_image_is_wrong(seen: list[TrainingView]) -> None:
    means = ball(torch.zeros(3)).means
    wrong = means[:, 0] > 0.2
    before = wrong_where(wrong)
    optimizer = optimizer_of(before)
    densify(optimizer, stepper(seen), EXTENT, 20, remove_huge=False)
    after = optimizer.gaussians.detach()
    assert len(after) == 320
    new = after.means[280:]
    assert (new[:, 0] > 0.1).all()
    assert len({tuple(place) for place in new.tolist()}) == 40
    torch.testing.assert_close(after.scales[280:], torch.full((40, 3), 0.035 / 1.6))
    gone = ~torch.isin(means[:, 1], after.means[:280, 1])
    assert gone.sum() == 20
    assert wrong[gone].all()
    middles = (new[:20] + new[20:]) / 2  # the children are in the order of their parents
    assert (middles - means[gone]).norm(dim=1).max() < 4 * 0.035


def test_splats_of_a_detail_are_split_at_smaller_errors(seen: list[TrainingView]) -> None:
    before = wrong_where(torch.ones(300, dtype=torch.bool))
    detail = Detail((0.5, 0.0, 0.0), 0.3, 9.0)
    inside = []
    for details in ((), (detail,)):
        optimizer = optimizer_of(before)
        marked = [view.with_details(details) for view in seen]
        densify(optimizer, stepper(marked), EXTENT, 20, remove_huge=False)
        near = (optimizer.gaussians.means[280:] - torch.tensor(detail.center)).norm(dim=1) < 0.4
        inside.append(int(near.sum()))
    assert inside[1] > inside[0] + 10


def test_faint_and_huge_splats_are_removed(seen: list[TrainingView]) -> None:
    optimizer = optimizer_of(ball(torch.zeros(3)))
    with torch.no_grad():
        optimizer.gaussians.logit_opacities[2] = math.log(0.004 / 0.996)
        optimizer.gaussians.log_scales[1] = math.log(0.11 * EXTENT)
    densify(optimizer, stepper(seen), EXTENT, 0, remove_huge=False)
    assert len(optimizer) == 299
    densify(optimizer, stepper(seen), EXTENT, 0, remove_huge=True)
    assert len(optimizer) == 298


def test_when_it_densifies_and_resets(seen: list[TrainingView], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("v3studio.studio.training.densify.RESET_EVERY", 15)
    settings = TrainSettings(densify_from=10, densify_until=41, densify_every=10, densify_max_splats=330)
    optimizer = optimizer_of(wrong_where(torch.ones(300, dtype=torch.bool)))
    grown, reset = {}, []
    for iteration in range(1, 60):
        before = len(optimizer)
        with torch.no_grad():
            optimizer.gaussians.logit_opacities.fill_(0.0)
        control_density(iteration, optimizer, stepper(seen), EXTENT, settings)
        if len(optimizer) > before:
            grown[iteration] = len(optimizer)
        if optimizer.gaussians.opacities.max() < 0.4:
            reset.append(iteration)
            assert optimizer.gaussians.opacities.max().item() == pytest.approx(0.01)
    assert grown == {20: 310, 30: 320, 40: 330}
    assert reset == [15, 30]  # none in the last quarter of densification
