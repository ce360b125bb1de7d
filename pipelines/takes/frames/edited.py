"""Trained frames with the take's edits: what is baked, evaluated and exported; details that follow these frames."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers, trained_groups
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError
from v3studio.studio.progress import ProgressFn

if TYPE_CHECKING:
    import torch

    from v3studio.studio.edits import DetailMark, EditList, Paths, Selection
    from v3studio.studio.gaussians import Gaussians


def edits_of_group(edits: EditList, group: Group) -> EditList:
    """The edits that concern a trained group: without regions that hold for other frames only, and without a trim."""
    return edits.with_(regions=tuple(region for region in edits.regions if concerns(region.frames, group)), trim=None)


def concerns(frames: tuple[int, int] | None, group: Group) -> bool:
    """Return whether a range of frames of the footage, as `Region.frames`, has frames of a group."""
    return frames is None or (frames[0] <= group.frames[-1] and group.frames[0] <= frames[1])


def read_paths(take: Take, group: Group) -> Paths:
    """The paths of a trained group's splats through its frames; StudioError if a frame is missing or damaged, or
    they have different numbers of splats (`take.not_trained`)."""
    from v3studio.studio.edits import Paths

    def frames() -> Iterator[Gaussians]:
        splats = None
        for index in group.indices:
            frame = read_frame(take.finished_frame(group.index, index))
            if len(frame) != (splats := splats or len(frame)):
                raise of_two_trainings(take, group.index)
            yield frame

    return Paths.of(group.frames, frames())


def of_two_trainings(take: Take, group: int) -> StudioError:
    """The error for a group whose frames do not have the same splats."""
    problem = f"frames of group {group} are from different trainings, as an interrupted one leaves them"
    fix = "Finish it with `v3studio train` first."
    return StudioError("take.not_trained", problem, file=take.root, fix=fix, stage="train")


def newly_removed(take: Take, before: EditList, after: Sequence[EditList], progress: ProgressFn) -> list[int]:
    """The numbers of splats that each of `after` removes and `before` does not. Reads all trained frames. Raises
    StudioError as `read_paths`."""
    from v3studio.studio.edits import select

    counts, groups = [0] * len(after), trained_groups(take)
    for done, group in enumerate(groups):
        progress(done, len(groups))
        paths = read_paths(take, group)
        old, *new = (select(edits_of_group(edits, group), paths).removed for edits in (before, *after))
        counts = [count + int((now & ~old).sum()) for count, now in zip(counts, new, strict=True)]
    return counts


def followed(take: Take, frame: int | None, center: np.ndarray, radius: float, weight: float) -> DetailMark:
    """A ball marked in a trained frame (its number in the footage; None: the first), with its path through all."""
    from v3studio.studio.edits import follow

    files, starts = take.trained_files()
    if not files:
        problem = "no trained frames yet, in which a detail could be marked and followed"
        fix = "Run `v3studio train`; a preview with few steps is enough."
        raise StudioError("take.not_trained", problem, file=take.root, fix=fix, stage="train")

    groups = trained_groups(take)
    numbers = FrameNumbers.of(groups)
    index = 0 if frame is None else numbers.index(frame)
    if index is None:
        fix = f"The trained frames are {numbers.known[0]} to {numbers.known[-1]}."
        raise StudioError("edits.nothing_there", f"frame {frame} is not trained", file=take.root, value=frame, fix=fix)

    splats: dict[int, int] = {}  # by group

    @lru_cache(maxsize=4)  # those around a border between groups
    def means_at(index: int) -> np.ndarray:
        means: np.ndarray = read_frame(files[index]).means.numpy()
        group = bisect_right(starts, index) - 1
        if splats.setdefault(group, len(means)) != len(means):
            raise of_two_trainings(take, group)
        return means

    mark = follow(means_at, [group.indices for group in groups], index, center, radius, weight)
    return mark.model_copy(update={"path": tuple((numbers.number(at), place) for at, place in mark.path)})


class EditedGroup:
    """A trained group with edits. `group`: the group, with all its frames."""

    def __init__(self, take: Take, group: Group, edits: EditList) -> None:
        self._take, self._group = take, group
        self._edits = edits_of_group(edits, group)
        self._kept: torch.Tensor | None = None

    def selection(self) -> Selection:
        """The splats that the edits remove. Reads all frames of the group. StudioError if one is missing or damaged."""
        from v3studio.studio.edits import select

        return select(self._edits, read_paths(self._take, self._group))

    def kept(self) -> torch.Tensor | None:
        """(M,) int64: the splats that are kept, ascending; None: all. The first call reads all frames of the group.
        StudioError if one is missing or damaged, or no splat is left (`edits.nothing_left`)."""
        import torch

        if self._edits.removes and self._kept is None:
            kept = np.flatnonzero(~self.selection().removed)
            if not len(kept):
                raise self._nothing_left()
            self._kept = torch.from_numpy(kept)
        return self._kept

    def unedited(self, index: int) -> Gaussians:
        """A frame as trained, counted from 0 in the take. Raises StudioError if it is missing or damaged."""
        return read_frame(self._take.finished_frame(self._group.index, index))

    def cut(self, gaussians: Gaussians, among: torch.Tensor | None = None) -> Gaussians:
        """All splats of a trained frame of the group, or those `among` them with these (K,) int64 numbers, without the
        ones that are removed, in the world of the capture."""
        import torch

        kept = self.kept()
        if kept is None:
            return gaussians
        if among is None:
            return gaussians[kept]
        chosen = gaussians[torch.isin(among, kept)]
        if not len(chosen):
            raise self._nothing_left()
        return chosen

    def edited(self, gaussians: Gaussians, among: torch.Tensor | None = None) -> Gaussians:
        """The frame as `cut` returns it, but in the world of the stream."""
        from v3studio.studio.formats.rigid_motion import placed

        return placed(self.cut(gaussians, among), self._edits.similarity)

    def read(self, index: int) -> Gaussians:
        """A frame, counted from 0 in the take, as it is baked. Raises StudioError: `edits.nothing_left`, or damage."""
        return self.edited(self.unedited(index))

    def _nothing_left(self) -> StudioError:
        problem = f"the edits remove all splats of group {self._group.index}"
        fix = "Undo an edit with `v3studio edit undo`, or make the crop box larger."
        return StudioError("edits.nothing_left", problem, file=self._take.edits, fix=fix, group=self._group.index)
