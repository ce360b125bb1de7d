"""Numbers of frames: people know a frame by its number in the footage, results count them from 0 in the take."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.stage_files import TrainedGroup
from v3studio.pipelines.takes.take import Take


@dataclass(frozen=True)
class FrameNumbers:
    """The numbers of a take's frames in the footage, ascending, by index in the take; if unknown, counted from 0."""

    known: tuple[int, ...] = ()

    @classmethod
    def of(cls, groups: Iterable[Group]) -> FrameNumbers:
        """The numbers of the frames of a take's groups, in their order."""
        return cls(tuple(frame for group in groups for frame in group.frames))

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

    def within(self, first: int, last: int) -> range:
        """Indices of the frames whose numbers are from `first` to `last`; of the known ones if any are."""
        if not self.known:
            return range(first, last + 1)
        return range(bisect_left(self.known, first), bisect_right(self.known, last))


def trained_groups(take: Take) -> list[Group]:
    """The groups of the trained frames, up to the first missing one. Raises StudioError: `take.*`."""
    files, starts = take.trained_files()
    groups = []
    for index, (start, end) in enumerate(pairwise((*starts, len(files)))):
        frames = read_model(take.train_group(index) / "group.json", TrainedGroup).frames
        groups.append(Group(index, start, frames[: end - start]))
    return groups


def frames_so_far(take: Take) -> tuple[dict[int, Path], list[Group]]:
    """Files of all trained frames by index in the take, ascending, and their groups with all frames. Training begins in
    the middle of a group, so the first frames of one may be missing. StudioError if a group's file is missing or
    damaged (`take.file_not_found`, `take.damaged`)."""
    files: dict[int, Path] = {}
    groups: list[Group] = []
    first = 0
    while (described := (folder := take.train_group(len(groups))) / "group.json").is_file() or any(
        folder.glob("frame_*.safetensors")
    ):
        group = Group(len(groups), first, read_model(described, TrainedGroup).frames)
        paths = {index: take.finished_frame(group.index, index) for index in group.indices}
        files |= {index: path for index, path in paths.items() if path.is_file()}
        groups.append(group)
        first += len(group.frames)
    return files, groups


def trained_numbers(take: Take) -> FrameNumbers:
    """The numbers of the trained frames. Raises StudioError as `trained_groups`."""
    return FrameNumbers.of(trained_groups(take))
