"""How far training is, in time rather than in frames: keyframes take much longer than the frames after them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipelines.takes.groups import Group
from studio.training.settings import TrainSettings


class TrainClock:
    """Fraction of the training time that is behind.

    Before anything is measured a frame weighs as many units as it has steps; measured seconds a kind of frame
    (keyframe, other) replace that as soon as there are some.
    """

    def __init__(self, groups: Sequence[Group], finished: Mapping[int, int], settings: TrainSettings) -> None:
        todo = [position for group in groups for position in range(finished[group.index], len(group.frames))]
        self._left = {True: todo.count(0), False: len(todo) - todo.count(0)}
        rounds = max(1, settings.prune_rounds)
        self._steps = {
            True: settings.keyframe_iterations + rounds * settings.prune_finetune_iterations,
            False: settings.motion_iterations + settings.finetune_iterations,
        }
        self._seconds: dict[bool, list[float]] = {True: [], False: []}
        self._current: dict[int, tuple[bool, float]] = {}

    def reached(self, group: Group, position: int, share: float) -> None:
        """`share` of the group's frame `position` is done."""
        self._current[group.index] = (position == 0, share)

    def finished(self, group: Group, position: int, seconds: float) -> None:
        """Frame `position` of the group took that long."""
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
        """Seconds a frame of this kind; scaled from the other kind's steps while none is measured."""
        if self._seconds[kind]:
            return sum(self._seconds[kind]) / len(self._seconds[kind])
        other = self._seconds[not kind]
        if other:
            return self._steps[kind] * (sum(other) / len(other)) / max(1, self._steps[not kind])
        return float(self._steps[kind])
