"""Where groups begin: at fixed intervals, or earlier where the performer differs too much from the keyframe.

The latter (train.grouping = motion) compares small versions of all frames from a few cameras. The stage `initialize`
does that once and stores the result in the take; until then groups have a fixed length.
"""

from collections.abc import Sequence

import numpy as np

from pipelines.stages.footage import TakeFootage
from pipelines.takes.atomic_files import digest_of, read_model, write_model
from pipelines.takes.groups import Group, cut_at, cut_into_groups
from pipelines.takes.stage_files import FoundGroups
from studio.progress import ProgressFn

CAMERAS = 8
"""Number of training cameras to compare, evenly spaced."""

FEWEST = 4
"""Minimum number of frames in a group, except the last: keyframes take more time and bytes than other frames."""

MOST_CHANGE = 0.6
"""Change of the performer's appearance, independent of their position, between a keyframe and its group's first or last
frame, above which a new group begins. 0: identical images; 1: nothing in common. The sample's 30 frames, which are best
as one group, reach 0.53."""


def groups_of(footage: TakeFootage) -> tuple[Group, ...]:
    """The take's groups, of fixed length until groups by motion are known."""
    settings, frames = footage.config.train, footage.raw.frames
    starts = None if settings.grouping == "fixed" else _found(footage)
    return cut_into_groups(frames, settings.group_size) if starts is None else cut_at(frames, starts)


def is_known(footage: TakeFootage) -> bool:
    """Whether groups have a fixed length or were found with these settings."""
    return footage.config.train.grouping == "fixed" or _found(footage) is not None


def _found(footage: TakeFootage) -> tuple[int, ...] | None:
    """Indices of the groups' first frames by motion; None if they were not found with these settings yet."""
    path = footage.take.grouping
    if not path.is_file():
        return None
    found = read_model(path, FoundGroups)
    return found.starts if found.key == key(footage) else None


def key(footage: TakeFootage) -> str:
    """Digest of everything that groups by motion depend on."""
    settings = footage.config.train
    seen = footage.seen_by_training()
    return digest_of([2, seen, list(footage.raw.frames), settings.group_size, MOST_CHANGE])


def find_groups(footage: TakeFootage, progress: ProgressFn) -> None:
    """Find where groups begin and write it to `Take.grouping`; does nothing if it is known."""
    if is_known(footage):
        return
    from studio.capture.change import look

    raw, settings = footage.raw, footage.config.train
    every = max(1, len(raw.train_cameras) // CAMERAS)
    cameras = raw.train_cameras[::every][:CAMERAS]
    looks: list[list[np.ndarray | None]] = []
    for number, frame in enumerate(raw.frames):
        progress(number, len(raw.frames))
        looks.append([look(raw.raw_image(name, frame), raw.raw_mask(name, frame)) for name in cameras])
    starts = starts_of(looks, settings.group_size, MOST_CHANGE)
    found = FoundGroups(key=key(footage), starts=tuple(starts), cameras=tuple(cameras))
    write_model(footage.take.grouping, found)


def starts_of(looks: Sequence[Sequence[np.ndarray | None]], longest: int, most: float) -> list[int]:
    """Choose where groups begin: indices of their first frames.

    Args:
        looks: per frame and camera, what `studio.capture.change.look` returns.
        most: change from the keyframe to the first or last frame that a group does not exceed.
    """
    starts = [0]
    for index in range(1, len(looks)):
        first, length = starts[-1], index - starts[-1]
        keyframe = looks[first + (length + 1) // 2]
        value = max(_change(keyframe, looks[first]), _change(keyframe, looks[index]))
        if length >= longest or (value > most and length >= FEWEST):
            starts.append(index)
    return starts


def _change(before: Sequence[np.ndarray | None], after: Sequence[np.ndarray | None]) -> float:
    """Mean over the cameras that see the performer in both frames."""
    from studio.capture.change import change

    found = [change(a, b) for a, b in zip(before, after, strict=True) if a is not None and b is not None]
    return float(np.mean(found)) if found else 0.0
