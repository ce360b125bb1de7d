"""The stages as the operator sees them, and how a take's stand."""

from __future__ import annotations

from dataclasses import dataclass, field

from pipelines.runs.staleness import StageStatus
from pipelines.stages.base import Context
from studio.errors import StudioError

TITLES = {
    "capture": "Capture",
    "calibrate": "Calibrate",
    "initialize": "Initialize",
    "train": "Train",
    "bake": "Bake",
    "review": "Review",
}
"""The stages as the operator sees them, in order."""

PIPELINE_NAMES = {"review": "evaluate"}
"""What the pipeline calls a stage where it is not the same."""


def pipeline_name(key: str) -> str:
    """A stage's name on the command line."""
    return PIPELINE_NAMES.get(key, key)


@dataclass(frozen=True)
class StageRow:
    """A line of the stage list.

    Attributes:
        key: of `TITLES`.
        state: done, partial, stale, failed, missing, running, or waiting (later in the run that goes on).
        words: beside the title, short.
        detail: why, in a sentence; "" where there is nothing to say.
        fraction: of the stage while it runs.
    """

    key: str
    state: str
    words: str
    detail: str = ""
    fraction: float | None = None

    @property
    def title(self) -> str:
        """For people."""
        return TITLES[self.key]


@dataclass(frozen=True)
class Assessment:
    """How the take stood when it was looked at.

    Attributes:
        stages: as `v3studio status` tells.
        footage: a few words on the footage; "" where it cannot be opened.
        footage_error: the sentence then.
        numbers: of the footage's frames, in its files; none where it cannot be opened.
        fps, group_starts: of the footage.
    """

    stages: dict[str, StageStatus] = field(default_factory=dict)
    footage: str = ""
    footage_error: str = ""
    numbers: tuple[int, ...] = ()
    fps: float = 30.0
    group_starts: tuple[int, ...] = (0,)


def assess(context: Context) -> Assessment:
    """How a take stands (worker thread: reads files)."""
    from pipelines.runs.runner import status

    try:
        footage = context.footage.raw
    except StudioError as error:
        return Assessment(status(context.take, context.config), footage_error=str(error))
    cameras, frames = len(footage.camera_names), len(footage.frames)
    words = f"{cameras} camera{'s' * (cameras != 1)}, {frames} frame{'s' * (frames != 1)}"
    starts = tuple(group.first for group in context.groups)
    numbers = tuple(int(frame) for frame in footage.frames)
    return Assessment(status(context.take, context.config), words, "", numbers, float(footage.fps), starts)
