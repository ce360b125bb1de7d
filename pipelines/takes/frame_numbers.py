"""Numbers of frames: people know a frame by its number in the footage, results count them from 0 in the take."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

from pipelines.takes.atomic_files import read_model
from pipelines.takes.stage_files import TrainedGroup
from pipelines.takes.take import Take


@dataclass(frozen=True)
class FrameNumbers:
    """The numbers of a take's frames.

    Attributes:
        known: frame numbers in the footage, ascending, by index in the take; none: they are counted from 0.
    """

    known: tuple[int, ...] = ()

    def number(self, index: int) -> int:
        """The number of a frame, also of one after the last that is known."""
        if index < len(self.known):
            return self.known[index]
        if not self.known:
            return index
        step = self.known[-1] - self.known[-2] if len(self.known) > 1 else 1
        return self.known[-1] + (index - len(self.known) + 1) * step

    def index(self, number: int) -> int | None:
        """The index of a frame; None if the take does not have it."""
        if not self.known:
            return number if number >= 0 else None
        at = bisect_left(self.known, number)
        return at if at < len(self.known) and self.known[at] == number else None


def trained_numbers(take: Take) -> FrameNumbers:
    """Those of the trained frames.

    Raises:
        StudioError: a group's file is damaged.
    """
    files, starts = take.trained_files()
    found: list[int] = []
    for group in range(len(starts)):
        path = take.train_group(group) / "group.json"
        if not path.is_file():
            return FrameNumbers()
        found += read_model(path, TrainedGroup).frames
    return FrameNumbers(tuple(found[: len(files)]))
