"""Decides how many splats of a keyframe are pruned, and in how many rounds."""

from v3studio.studio.training.settings import TrainSettings


def prune_rounds(settings: TrainSettings, splats: int) -> int:
    """Number of pruning rounds: at least one, and enough to reach `settings.max_splats`."""
    rounds = 0
    while rounds == 0 or splats > settings.max_splats:
        splats -= pruned_in_round(settings, splats, rounds)
        rounds += 1
    return rounds


def pruned_in_round(settings: TrainSettings, splats: int, rounds: int) -> int:
    """Number of splats that a round removes: at least one, never all; later no more than `max_splats` needs."""
    count = int(splats * settings.prune_ratio)
    if rounds > 0:
        count = min(count, splats - settings.max_splats)
    return min(splats - 1, max(1, count))


def splats_after_pruning(settings: TrainSettings, splats: int) -> int:
    """Number of splats that all rounds leave."""
    for rounds in range(prune_rounds(settings, splats)):
        splats -= pruned_in_round(settings, splats, rounds)
    return splats
