"""Details of a take: balls that follow the trained frames."""

from __future__ import annotations

from bisect import bisect_right
from functools import lru_cache
from typing import TYPE_CHECKING

from pipelines.takes.edited import of_two_trainings
from pipelines.takes.frame_files import read_frame
from pipelines.takes.frame_numbers import FrameNumbers, trained_groups
from pipelines.takes.take import Take
from studio.errors import StudioError

if TYPE_CHECKING:
    import numpy as np

    from studio.edits import DetailMark


def followed(take: Take, frame: int | None, center: np.ndarray, radius: float, weight: float) -> DetailMark:
    """A ball marked in a trained frame (its number in the footage; None: the first), with its path through all."""
    from studio.edits import follow

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
        found: np.ndarray = read_frame(files[index]).means.numpy()
        group = bisect_right(starts, index) - 1
        if splats.setdefault(group, len(found)) != len(found):
            raise of_two_trainings(take, group)
        return found

    found = follow(means_at, [group.indices for group in groups], index, center, radius, weight)
    return found.model_copy(update={"path": tuple((numbers.number(at), place) for at, place in found.path)})
