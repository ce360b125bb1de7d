"""Rounds of pruning: how many there are, and what each removes."""

import pytest
import torch

from tests.studio.training.test_group import ball, views_of
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.training import train_keyframe
from v3studio.studio.training.pruning import prune_rounds, splats_after_pruning
from v3studio.studio.training.settings import TrainSettings


def settings(limit: int) -> TrainSettings:
    return TrainSettings(max_splats=limit, prune_ratio=0.3)


@pytest.mark.parametrize(
    ("splats", "rounds", "left"), [(500, 1, 350), (1001, 1, 701), (1429, 2, 1000), (4000, 4, 1000)]
)
def test_the_first_round_prunes_by_the_ratio_and_others_stop_at_the_limit(splats: int, rounds: int, left: int) -> None:
    """4000 splats: 2800, 1960 and 1372 by the ratio, of which the last round removes 372 instead of 411."""
    assert prune_rounds(settings(1000), splats) == rounds
    assert splats_after_pruning(settings(1000), splats) == left


def half_textured() -> Gaussians:
    """A ball whose lower half (y above 0) is gray and whose upper half has its checkers."""
    truth = ball(torch.zeros(3))
    truth.sh[truth.means[:, 1] > 0] = 0
    return truth


def test_pruning_by_contribution_removes_hidden_splats() -> None:
    """Opaque splats inside the ball are seen by nobody, so pruning by opacity keeps them."""
    views = views_of(half_textured())
    inside = 0.3 * half_textured().means[:60]
    points = torch.cat([half_textured().means, inside])
    chosen = {"keyframe_iterations": 1, "densify_until": 0, "prune_finetune_iterations": 0, "prune_ratio": 60 / 360}
    colors = torch.full((360, 3), 0.5)

    def hidden(how: str) -> int:
        settings = TrainSettings(prune_by=how, **chosen)  # type: ignore[arg-type]
        left = train_keyframe(views, points, colors, settings, seed=1)
        assert len(left) == 300
        return int((left.means.norm(dim=1) < 0.25).sum())

    assert hidden("opacity") > 40
    assert hidden("contribution") < hidden("opacity") / 2
