"""Rounds of pruning: how many there are, and what each removes."""

from __future__ import annotations

import pytest

from studio.training.pruning import prune_rounds, pruned_in_round, splats_after_pruning
from studio.training.settings import TrainSettings


def settings(limit: int) -> TrainSettings:
    return TrainSettings(max_splats=limit, prune_ratio=0.3)


@pytest.mark.parametrize(
    ("splats", "rounds", "left"), [(500, 1, 350), (1001, 1, 701), (1429, 2, 1000), (4000, 4, 1000)]
)
def test_the_first_round_prunes_by_the_ratio_and_further_rounds_stop_at_the_limit(
    splats: int, rounds: int, left: int
) -> None:
    """4000 splats: 2800, 1960 and 1372 by the ratio, of which the last round removes 372 instead of 411."""
    assert prune_rounds(settings(1000), splats) == rounds
    assert splats_after_pruning(settings(1000), splats) == left


def test_a_round_removes_at_least_one_splat_but_never_all() -> None:
    assert pruned_in_round(settings(10), 2, 0) == 1
    assert pruned_in_round(settings(10), 1, 0) == 0
