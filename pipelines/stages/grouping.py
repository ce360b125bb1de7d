"""Where groups begin: every so many frames, or earlier where the performer has changed too much for one keyframe.

The second way looks at all frames, small and through a few cameras. The initialize stage does that once and leaves what
it found in the take; until then the groups are those of fixed length.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipelines.config.renamed import first_names
from pipelines.stages.footage import TakeFootage
from pipelines.takes.atomic_files import digest_of, read_json, write_json
from pipelines.takes.groups import Group, cut_at, cut_into_groups
from studio.progress import ProgressFn

CAMERAS = 8
"""That are looked at, evenly taken from the training cameras."""

FEWEST = 4
"""Frames that a group has at least, but for the last: keyframes cost more time and more bytes than other frames."""


def groups_of(footage: TakeFootage) -> tuple[Group, ...]:
    """The take's groups, as far as they are known (see the module)."""
    settings, frames = footage.config.train, footage.raw.frames
    starts = None if settings.grouping == "fixed" else _found(footage)
    return cut_into_groups(frames, settings.group_size) if starts is None else cut_at(frames, starts)


def is_known(footage: TakeFootage) -> bool:
    """Whether the groups stand: their length is fixed, or the footage was looked at with these settings."""
    return footage.config.train.grouping == "fixed" or _found(footage) is not None


def _found(footage: TakeFootage) -> list[int] | None:
    """Where groups begin by motion; None where nobody has looked with these settings."""
    path = footage.take.grouping
    values = read_json(path) if path.is_file() else {}
    return values["starts"] if values.get("key") == key(footage) else None


def key(footage: TakeFootage) -> str:
    """Digest of all that the groups by motion depend on."""
    settings = footage.config.train
    seen = first_names(footage.seen_by_training())
    return digest_of([1, seen, list(footage.raw.frames), settings.group_size, settings.group_change])


def find_groups(footage: TakeFootage, progress: ProgressFn) -> None:
    """Look at the footage and write where groups begin (`Take.grouping`); nothing where that is known.

    Raises:
        StudioError: an image or a mask that cannot be read.
        Cancelled: from `progress`.
    """
    if is_known(footage):
        return
    from studio.capture.change import look

    raw, settings = footage.raw, footage.config.train
    every = max(1, len(raw.train_cameras) // CAMERAS)
    cameras = raw.train_cameras[::every][:CAMERAS]
    looks: list[list[np.ndarray | None]] = []
    for number, frame in enumerate(raw.frames):
        progress(number, len(raw.frames))
        looks.append([look(raw.raw_image(name, frame), raw.raw_matte(name, frame)) for name in cameras])
    starts, changes = starts_of(looks, settings.group_size, settings.group_change)
    values: dict[str, Any] = {"key": key(footage), "starts": starts, "changes": [round(value, 4) for value in changes]}
    write_json(footage.take.grouping, {**values, "cameras": list(cameras)})


def starts_of(looks: Sequence[Sequence[np.ndarray | None]], longest: int, most: float) -> tuple[list[int], list[float]]:
    """Where groups begin.

    Args:
        looks: of each frame, a picture a camera as `studio.capture.change.look` makes them.
        longest: frames a group at most.
        most: change against the keyframe at which the next group begins.

    Returns:
        indices of keyframes; and for each frame how much it has changed since its keyframe, mean over cameras.
    """
    from studio.capture.change import change

    starts, changes = [0], [0.0]
    for index in range(1, len(looks)):
        pairs = zip(looks[starts[-1]], looks[index], strict=True)
        found = [change(before, after) for before, after in pairs if before is not None and after is not None]
        value = float(np.mean(found)) if found else 0.0
        length = index - starts[-1]
        if length >= longest or (value > most and length >= FEWEST):
            starts.append(index)
            value = 0.0
        changes.append(value)
    return starts, changes
