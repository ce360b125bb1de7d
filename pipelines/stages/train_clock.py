"""Progress of training in time rather than in frames: keyframes take much longer than other frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipelines.takes.groups import Group
from studio.training.settings import TrainSettings

_MOTION_NETWORK, _MOTION_VIEW = 0.5, 0.75
"""Time of a step of motion in steps of keyframes or fine-tuning: that of its network, and of each view (sample capture,
quickstart with two views, 2 cores: 78 s for the 3200 steps of a keyframe, 14 s for 170 steps of motion and 250 of
fine-tuning; the network takes a quarter of a motion step, docs/measurements/training.md)."""

_HALF_SIZE = 0.57
"""Time of a view at half size in that of one at full size (docs/measurements/training.md: 19 ms instead of 33.5)."""


class TrainClock:
    """Elapsed fraction of the training time.

    At first, frames are weighted by their number of training steps, where one of motion counts as several; then by
    measured seconds per kind of frame (keyframe or other).

    Args:
        groups: all groups of the take.
        finished: number of frames trained before this run, by group index.
        settings: training settings.
    """

    def __init__(self, groups: Sequence[Group], finished: Mapping[int, int], settings: TrainSettings) -> None:
        todo = [position for group in groups for position in range(finished[group.index], len(group.frames))]
        self._left = {True: todo.count(0), False: len(todo) - todo.count(0)}
        rounds = max(1, settings.prune_rounds)
        self._steps = {
            True: settings.keyframe_iterations + rounds * settings.prune_finetune_iterations,
            False: _motion_step(settings) * settings.motion_iterations + settings.finetune_iterations,
        }
        self._seconds: dict[bool, list[float]] = {True: [], False: []}
        self._current: dict[int, tuple[bool, float]] = {}

    def reached(self, group: Group, position: int, share: float) -> None:
        """The fraction `share` (0 to 1) of the group's frame `position` is trained."""
        self._current[group.index] = (position == 0, share)

    def finished(self, group: Group, position: int, seconds: float) -> None:
        """Frame `position` of the group is trained and took `seconds`."""
        kind = position == 0
        self._seconds[kind].append(seconds)
        self._left[kind] -= 1
        self._current.pop(group.index, None)

    @property
    def fraction(self) -> float:
        """0 to 1."""
        behind = sum(len(self._seconds[kind]) * self._weight(kind) for kind in (True, False))
        ahead = sum(self._left[kind] * self._weight(kind) for kind in (True, False))
        for kind, share in self._current.values():
            part = share * self._weight(kind)
            behind, ahead = behind + part, ahead - part
        return min(1.0, behind / (behind + ahead)) if behind + ahead > 0 else 1.0

    def _weight(self, kind: bool) -> float:
        """Seconds per frame of this kind; estimated from the other kind until one is measured."""
        if self._seconds[kind]:
            return sum(self._seconds[kind]) / len(self._seconds[kind])
        other = self._seconds[not kind]
        if other:
            return self._steps[kind] * (sum(other) / len(other)) / max(1, self._steps[not kind])
        return float(self._steps[kind])


def _motion_step(settings: TrainSettings) -> float:
    """Mean time of a step of motion, in steps of keyframes or fine-tuning."""
    share = settings.motion_half_size
    return _MOTION_NETWORK + _MOTION_VIEW * settings.motion_views * (1 - share + share * _HALF_SIZE)
