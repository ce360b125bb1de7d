"""Main figures of each stage: in its record, in the event `stage_finished`, and as words with units for people."""

import contextlib
from collections.abc import Mapping

from pydantic import ValidationError

from v3studio.pipelines.takes.files.json_files import Result
from v3studio.pipelines.takes.results.evaluation import EvaluationSummary
from v3studio.studio.counts import counted, size_words, span
from v3studio.studio.json_types import JsonData


class CalibrateSummary(Result):
    """Main figures of `calibrate`."""

    cameras: int
    source: str  # file, board, tie points or footage

    grade: str | None = None
    """good, usable or wrong, by matches between the images that the cameras were not made from; not set if `initialize`
    checks them first."""

    mean_error_px: float | None = None  # mean reprojection error in pixels

    match_inlier_ratio: float | None = None
    """Fraction of the matches between cameras that agree with the result, 0 to 1."""

    @property
    def words(self) -> list[str]:
        """One part of a sentence each; "" for what is not known."""
        origin = "a camera file" if self.source == "file" else f"the {self.source}"
        return [
            f"{counted(self.cameras, 'camera')} from {origin}",
            "" if self.grade is None else f"checked: {self.grade}",
            "" if self.mean_error_px is None else f"mean reprojection error {self.mean_error_px:.2f} px",
            "" if self.match_inlier_ratio is None else f"{self.match_inlier_ratio:.0%} of the matches agree",
        ]


class InitializeSummary(Result):
    """Main figures of `initialize`."""

    groups: int
    points_per_group: int
    faces: tuple[int, ...]  # triangles of each group's mesh

    @property
    def words(self) -> list[str]:
        """The main figures for people."""
        parts = (f"{self.points_per_group:,} points", f"{span(self.faces)} triangles")
        return [counted(self.groups, "group"), *(f"{part}{' each' * (self.groups > 1)}" for part in parts)]


class SetSummary(Result):
    """Main figures of `set`."""

    splats: int
    psnr: float | None = None  # against the plates of the training cameras, their mean, dB
    reason: str = ""  # why there is no set

    @property
    def words(self) -> list[str]:
        """The main figures for people."""
        if self.psnr is None:
            return [self.reason]
        return [f"{self.splats:,} splats", f"PSNR {self.psnr:.1f} dB of the plates"]


class TrainSummary(Result):
    """Main figures of `train`."""

    groups: int
    frames: int
    splats: tuple[int, ...]  # Gaussians of each group
    outlines_off: tuple[float | None, ...]  # of each group, see `TrainedGroup`; rounded

    @property
    def words(self) -> list[str]:
        """The main figures for people."""
        off = [share for share in self.outlines_off if share is not None]
        return [
            f"{counted(self.frames, 'frame')} in {counted(self.groups, 'group')}",
            f"{span(self.splats)} splats{' per group' * (len(self.splats) > 1)}",
            f"masks and splats disagree along {span(off)}% of the outlines" if off else "",
        ]


class BakeSummary(Result):
    """Main figures of `bake`."""

    groups: int
    frames: int
    renditions: int = 1  # of which a player fetches one at a time
    bytes: int  # size of the whole stream: all renditions, sound and manifest

    bytes_per_frame: int
    """Bytes that playing the best rendition takes, with sound and manifest, divided by the number of frames."""

    qps: tuple[int, ...]  # of each group's best rendition
    psnr_to_trained: float | None = None  # of the group with the lowest, dB; None if it was not measured

    unsmoothed: tuple[int, ...] = ()
    """Groups whose level is out of reach with smooth paths, so that they are left as they are."""

    @property
    def words(self) -> list[str]:
        """The main figures for people."""
        several = self.renditions > 1
        return [
            f"{counted(self.frames, 'frame')} in {counted(self.groups, 'group')}",
            size_words(self.bytes) + (f" in {self.renditions} renditions" if several else ""),
            size_words(self.bytes_per_frame) + (" per frame to play the best one" if several else " per frame"),
            f"QP {span(self.qps)}",
            "" if self.psnr_to_trained is None else f"{self.psnr_to_trained:.1f} dB to trained",
            f"without smooth paths: group {', '.join(map(str, self.unsmoothed))}" if self.unsmoothed else "",
        ]


_Summary = CalibrateSummary | InitializeSummary | SetSummary | TrainSummary | BakeSummary | EvaluationSummary
_SUMMARIES: dict[str, type[_Summary]] = {
    "calibrate": CalibrateSummary,
    "initialize": InitializeSummary,
    "set": SetSummary,
    "train": TrainSummary,
    "bake": BakeSummary,
    "evaluate": EvaluationSummary,
}


def summary_words(stage: str, summary: Mapping[str, JsonData]) -> str:
    """One line, for example "30 frames in 2 groups, 31,906 splats"; names and values of what is not such a summary."""
    with contextlib.suppress(KeyError, ValidationError):
        return ", ".join(filter(None, _SUMMARIES[stage].model_validate(summary).words))
    return ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in summary.items())
