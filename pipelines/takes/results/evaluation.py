"""evaluation.json: image quality of the trained Gaussians and of the decoded stream, and how it was measured."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import create_model

from v3studio.pipelines.takes.files.json_files import Result, read_model
from v3studio.pipelines.takes.results.records import read_record, result_of
from v3studio.pipelines.takes.take import Take
from v3studio.studio.capture.patterns import number_ranges
from v3studio.studio.comparison.metrics import EVALUATED, MAIN, Metric
from v3studio.studio.counts import cameras_listed, counted, size_words

MEASURES = tuple(f"{metric.name}_{what}" for metric in EVALUATED for what in ("trained", "decoded"))
"""Figures of a row, in order: metrics of trained and decoded frames. LPIPS only with evaluate.lpips."""

if TYPE_CHECKING:  # type checkers do not see made fields
    _Figures = Result
else:
    _Figures = create_model("_Figures", __base__=Result, **dict.fromkeys(MEASURES, (float | None, None)))


class Quality(_Figures):
    """Image quality of a view, or the mean over views: fields by `MEASURES`, None if not measured. PSNR in dB, at most
    100, of footage cut out by its mask: interior, more than 3 pixels inside the mask (None if no part is so thick);
    outline, up to 3 pixels from the mask's outline. PSNR over the set against the uncut footage, None if the set is not
    known: performer, by mask or by difference from the set; moving, the box around that; picture, all of it, and after
    a color fit. Of a camera without masks only these are measured. SSIM and LPIPS in 0 to 1."""

    @property
    def measures(self) -> dict[str, float]:
        """Metrics by name, in the order of `MEASURES`, without those that were not measured."""
        measured = {name: getattr(self, name) for name in MEASURES}
        return {name: value for name, value in measured.items() if value is not None}


class FrameQuality(Quality):
    """One frame: the mean over its measured cameras."""

    psnr_trained: float
    psnr_decoded: float

    index: int
    """Counted from 0 in the take."""

    frame: int
    """Frame number in the footage."""

    group: int
    starts_group: bool
    splats: int

    bytes: float
    """Size of the group's files divided by its number of frames; manifest and sound are not part of it."""

    flicker: float | None = None
    """RMS change of the decoded residual from the frame before, in levels of 0 to 255, mean over cameras; None for the
    first frame."""

    cameras: dict[str, Quality]
    """Quality by camera name; cameras that do not see the performer in this frame are left out."""


class EvaluationSummary(Quality):
    """Means over all frames."""

    psnr_trained: float
    psnr_decoded: float

    bytes_per_frame: float
    """`protocol.total_bytes` divided by the number of frames: with manifest and sound, hence above the frames' mean."""

    psnr_trained_lowest_frame: float
    psnr_decoded_lowest_frame: float
    frames_contradicting_masks: int = 0
    """Frames whose masks contradict the footage, see `MaskCheck`."""

    flicker: float | None = None
    """Mean over frames."""

    flicker_at_group_borders: float | None = None
    """Mean over the first frames of groups."""

    @property
    def words(self) -> list[str]:
        """One part of a sentence each."""
        parts, measures = [], self.measures
        for metric in EVALUATED:
            if f"{metric.name}_decoded" in measures:
                decoded, trained = (metric.text(measures[f"{metric.name}_{what}"]) for what in ("decoded", "trained"))
                parts.append(f"{metric.title} {decoded} (before baking {trained})")
            if metric is MAIN:
                parts.append(f"lowest frame {metric.text(self.psnr_decoded_lowest_frame)}")
        parts.append(f"{size_words(self.bytes_per_frame)} per frame")
        if self.flicker is not None:
            borders = self.flicker_at_group_borders
            at = "" if borders is None else f" ({borders:.1f} at group borders)"
            parts.append(f"flicker {self.flicker:.1f} of 255 levels{at}")
        if self.frames_contradicting_masks:
            parts.append(f"masks contradict the footage in {counted(self.frames_contradicting_masks, 'frame')}")
        return parts


class Contradiction(Result):
    """A mask that contradicts the footage."""

    frame: int
    """Frame number in the footage."""

    camera: str

    kind: Literal["missing", "extra"]
    """missing: the mask lacks a part that looks like the performer. extra: it has a part that looks like the set."""

    share: float
    """Area of the part as a fraction of the performer's, 0 to 1."""


class MaskCheck(Result):
    """The comparison of masks with the footage, independent of splats."""

    evidence: Literal["set", "masks"]
    """What masks were compared with. set: differences from the empty set, and masks of the frames before and after.
    masks: these and, with 6 cameras or more, the masks of the other cameras."""

    cameras: tuple[str, ...]
    """The cameras whose masks were checked, in all evaluated frames."""

    least_share: float
    """Share of the performer's area from which a contradiction counts."""

    contradictions: tuple[Contradiction, ...]

    @property
    def frames(self) -> tuple[int, ...]:
        """Numbers of frames with contradictions, in order."""
        return tuple(sorted({each.frame for each in self.contradictions}))

    @property
    def words(self) -> str:
        """Return what contradicts the footage: frames, cameras, and shares of the performer's area; "" if nothing
        does."""
        parts = []
        for kind, end in (("missing", "is not in the masks"), ("extra", "in the masks looks like the set")):
            wrong = [each for each in self.contradictions if each.kind == kind]
            if wrong:
                frames = sorted({each.frame for each in wrong})
                cameras = [name for name in self.cameras if any(each.camera == name for each in wrong)]
                of = cameras_listed(cameras) if len(cameras) <= 6 else f"{len(cameras)} cameras"
                most = max(each.share for each in wrong)
                words = f"{counted(len(frames), 'frame')} ({number_ranges(frames)}) of {of}"
                parts.append(f"up to {most:.0%} of the performer's area {end} in {words}")
        return f"the masks contradict the footage: {'; '.join(parts)}" if parts else ""


class Protocol(Result):
    """The way in which the quality was measured."""

    cameras: tuple[str, ...]

    held_out: bool
    """False: no camera with masks was held out, so training cameras were measured."""

    note: str

    resolution: dict[str, tuple[int, int]]
    """Width and height in pixels by camera name."""

    crop: str

    background: tuple[float, float, float]
    """RGB, 0 to 1."""

    footage: str
    """The way in which the images that are compared with are made."""

    uncut: str | None = None
    """The way in which splats are compared with the uncut footage; None: they are not."""

    frames: tuple[int, ...]
    mean: str
    ssim: str
    lpips: str | None = None
    total_bytes: int
    total_bytes_are: str
    set_bytes: int
    """Bytes of the set, which is sent once; not in `total_bytes`."""

    bytes_of_a_frame: str


class Evaluation(Result):
    """Contents of evaluation.json."""

    summary: EvaluationSummary
    protocol: Protocol

    cameras: dict[str, Quality]
    """Means over frames, by camera name."""

    frames: tuple[FrameQuality, ...]
    masks: MaskCheck

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The metrics that were measured."""
        return tuple(metric for metric in EVALUATED if f"{metric.name}_decoded" in self.summary.measures)


def read_evaluation(path: Path | str) -> Evaluation:
    """Read evaluation.json. Raises StudioError: `take.file_not_found` or `take.damaged`.

    Example:
        >>> evaluation = v3.read_evaluation(v3.Take.open("my-take").evaluation)
        >>> evaluation.summary.psnr_decoded > 15, [row.frame for row in evaluation.frames]
        (True, [0, 1, 2, 3, 4])
    """
    return read_model(Path(path), Evaluation)


def measured_earlier_bake(take: Take) -> bool:
    """Return whether the stream has been baked again since it was measured."""
    record = read_record(take, "evaluate")
    return record is not None and record.params.get("result of bake") != result_of(take, "bake")
