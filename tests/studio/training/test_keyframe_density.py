"""A keyframe has as many splats as the settings say, and hidden ones are pruned."""

from __future__ import annotations

import torch

from studio.gaussians import Gaussians
from studio.training import TrainingView, TrainSettings, train_keyframe
from tests.studio.training.test_group import ball, views_of

TEXTURED = 300


def half_textured() -> Gaussians:
    """A ball whose lower half (y above 0) is gray and whose upper half has its checkers."""
    truth = ball(torch.zeros(3))
    truth.sh[truth.means[:, 1] > 0] = 0
    return truth


def trained(views: list[TrainingView], **changes: object) -> tuple[Gaussians, list[int]]:
    """The keyframe, and the number of splats after each figure that training told."""
    generator = torch.Generator().manual_seed(0)
    start = half_textured().means + 0.02 * torch.randn(TEXTURED, 3, generator=generator)
    settings = TrainSettings(
        **{  # type: ignore[arg-type]
            "keyframe_iterations": 200,
            "densify_from": 20,
            "densify_until": 160,
            "densify_every": 10,
            "densify_max_splats": 420,
            "densify_gradient": 1e-6,
            "prune_finetune_iterations": 20,
            "prune_ratio": 0.1,
            **changes,
        }
    )
    counts: list[int] = []

    def told(done: int, total: int, **figures: object) -> None:
        if "splats" in figures:
            counts.append(int(str(figures["splats"])))

    found = train_keyframe(views, start, torch.full((TEXTURED, 3), 0.5), settings, seed=1, progress=told)
    return found, counts


def test_splats_are_added_up_to_the_maximum_and_then_pruned_to_theirs() -> None:
    views = views_of(half_textured())
    one, counts = trained(views)
    assert max(counts) == 420
    assert len(one) == 378
    few, counts = trained(views, densify_max_splats=330, max_splats=200, prune_ratio=0.3)
    assert max(counts) == 330
    assert len(few) == 200


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
