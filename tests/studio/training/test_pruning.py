"""Rounds of pruning: how many there are, and what each removes."""

from __future__ import annotations

import pytest

from studio.training.pruning import prune_rounds, pruned_in_round, splats_after_pruning
from studio.training.settings import TrainSettings


def settings(limit: int, ratio: float = 0.3, rounds: int = 1) -> TrainSettings:
    return TrainSettings(max_splats=limit, prune_ratio=ratio, prune_rounds=rounds)


def test_the_rounds_that_were_asked_for_prune_by_the_ratio() -> None:
    assert prune_rounds(settings(1000), 500) == 1
    assert splats_after_pruning(settings(1000), 500) == 350
    assert splats_after_pruning(settings(1000, rounds=2), 500) == 245
    assert splats_after_pruning(settings(1000, rounds=0), 500) == 500


@pytest.mark.parametrize(("splats", "rounds"), [(1001, 1), (1429, 2), (4000, 4)])
def test_further_rounds_stop_at_the_limit(splats: int, rounds: int) -> None:
    """4000 splats: 2800, 1960 and 1372 by the ratio, of which the last round removes 372 instead of 411."""
    chosen = settings(1000)
    assert prune_rounds(chosen, splats) == rounds
    assert splats_after_pruning(chosen, splats) == (1000 if rounds > 1 else 701)


def test_a_round_removes_at_least_one_splat_but_never_all() -> None:
    assert pruned_in_round(settings(10), 2, 0) == 1
    assert pruned_in_round(settings(10), 1, 0) == 0
    assert splats_after_pruning(settings(10, rounds=3), 2) == 1
