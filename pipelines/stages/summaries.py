"""Main figures of each stage: in its record, in the event `stage_finished`, and in the summary line."""

from __future__ import annotations

from pipelines.takes.atomic_files import Result
from pipelines.takes.evaluation import EvaluationSummary

__all__ = [
    "BakeSummary",
    "CalibrateSummary",
    "EvaluationSummary",
    "InitializeSummary",
    "TrainSummary",
]


class CalibrateSummary(Result):
    """Main figures of `calibrate`."""

    cameras: int

    source: str
    """file, board, tie points or footage."""

    grade: str | None = None
    """good, usable or wrong, by matches between the images that the cameras were not made from; not set if `initialize`
    checks them first."""

    mean_error_px: float | None = None
    """Mean reprojection error in pixels."""

    match_inlier_ratio: float | None = None
    """Fraction of the matches between cameras that agree with the result, 0 to 1."""


class InitializeSummary(Result):
    """Main figures of `initialize`."""

    groups: int
    points_per_group: int

    faces: tuple[int, ...]
    """Triangles of each group's mesh."""


class TrainSummary(Result):
    """Main figures of `train`."""

    groups: int
    frames: int

    splats: tuple[int, ...]
    """Gaussians of each group."""

    outlines_off: tuple[float | None, ...]
    """Of each group, see `TrainedGroup`; rounded."""


class BakeSummary(Result):
    """Main figures of `bake`."""

    groups: int
    frames: int

    renditions: int = 1
    """Of which a player fetches one at a time."""

    bytes: int
    """Size of the whole stream: all renditions, sound and manifest."""

    bytes_per_frame: int
    """Bytes that playing the best rendition takes, with sound and manifest, divided by the number of frames."""

    qps: tuple[int, ...]
    """Of each group's best rendition."""

    psnr_to_trained: float | None = None
    """Of the group with the lowest, dB; None if it was not measured."""

    unsmoothed: tuple[int, ...] = ()
    """Groups whose level is out of reach with smooth paths, so that they are left as they are."""
