"""The settings models. The text under a field is its documentation, shown by `v3studio config` and in the window.

Defaults are the paper's where it names a value. Functions of `studio` take plain arguments;
`pipelines.stages.arguments` makes them of these.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from pipelines.config.calibrate_section import CalibrateSection
from pipelines.config.capture_section import CaptureSection
from pipelines.config.section import Section
from pipelines.config.train_section import TrainSection


class InitializeSection(Section):
    """Points for each group's keyframe, from the visual hull of the masks."""

    headings: ClassVar[dict[str, str]] = {
        "points": "Points",
        "resolution": "Hull",
        "smoothing": "Surface",
    }

    points: int = Field(default=50_000, ge=100, le=5_000_000)
    """How many points are sampled on the hull's surface."""

    resolution: int = Field(default=256, ge=16, le=1024)
    """Voxels along the hull's longest side; fewer where pixels are coarser than that."""

    tolerance: float = Field(default=0.1, ge=0, le=0.5)
    """Share of the cameras whose masks the others may outvote; 0 turns the vote off."""

    min_view_share: float | None = Field(default=None, ge=0, le=1)
    """Share of the cameras that must see a point for it to count; null is one half, and less where that leaves
    performer unexplained."""

    smoothing: float = Field(default=0.7, ge=0, le=10)
    """Smoothing of the surface, in voxels."""

    max_faces: int = Field(default=200_000, ge=100)
    """Most faces of the mesh."""


QP = Annotated[int, Field(ge=0, le=51)]


class BakeSection(Section):
    """From trained Gaussians to the stream."""

    headings: ClassVar[dict[str, str]] = {
        "profile": "Size and quality",
        "codec": "Encoding",
    }

    profile: Literal["motion", "planes"] = "motion"
    """motion: blocks of splats that move alike, and one small video of what that leaves. planes: the paper's, a video
    for each number of a splat."""

    qp: QP = 20
    """Quantization parameter: 0 is lossless, higher is smaller and coarser. In planes, above 22 color, scale and
    rotation stay at 22 and the rest follows, as in the paper; the positions' high bytes are always lossless."""

    target_kb_per_frame: Annotated[float, Field(gt=0)] | None = None
    """Instead of qp: the best quality at which each group's files have at most this many kilobytes (1000 bytes) a
    frame."""

    target_psnr: Annotated[float, Field(gt=0, le=100)] | None = None
    """Instead of qp: the smallest stream whose decoded frames, drawn from a few cameras, reach this PSNR in dB against
    the frames as trained, in each group."""

    codec: Literal["h264", "hevc", "av1"] = "h264"
    """h264 plays everywhere; motion can also be written as hevc or av1."""

    attribute_qps: dict[Literal["means_low", "opacities", "scales", "quats", "sh"], QP] = Field(default={})
    """QPs that replace that rule for single attributes, as in {opacities: 26}."""

    preset: Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow"] = (
        "medium"
    )
    """How hard the encoder tries: slower ones spend fewer bytes."""

    mirror_low_bytes: bool = True
    """Let the positions' low bytes run backwards where the high byte is odd, so that they do not jump from 255 to 0.
    false gives the paper's plain low byte."""

    @model_validator(mode="after")
    def _fits_together(self) -> BakeSection:
        if self.target_kb_per_frame is not None and self.target_psnr is not None:
            raise ValueError("target_kb_per_frame and target_psnr are both set; give one of them")
        if self.profile == "planes" and self.codec != "h264":
            raise ValueError(f"codec = {self.codec} is written for profile = motion only")
        if self.codec == "av1" and self.qp == 0:
            raise ValueError("qp = 0 (lossless) is not written as av1; choose h264 or hevc, or qp = 1")
        return self


class EvaluateSection(Section):
    """Measuring what was trained and what was baked."""

    headings: ClassVar[dict[str, str]] = {
        "crop_padding": "Evaluation",
    }

    crop_padding: int = Field(default=8, ge=0, le=10_000)
    """Figures are taken in the box of the performer's mask, padded by this many pixels."""

    lpips: Literal["alex", "vgg"] | None = None
    """Measure LPIPS as well, through AlexNet (alex, its authors' choice for comparing) or VGG16 (vgg); null does not.
    The network's weights (244 or 553 MB) are fetched from download.pytorch.org on first use."""

    report_frames: int = Field(default=4, ge=1, le=100)
    """How many frames the report shows pictures of, spread over the take."""

    report_width: int = Field(default=420, ge=64, le=4096)
    """Pictures in the report are at most this many pixels wide."""


class RunSection(Section):
    """The run itself."""

    headings: ClassVar[dict[str, str]] = {
        "seed": "Run",
    }

    seed: int = Field(default=0, ge=0, lt=2**31)
    """Seed of all that is random: the same seed gives the same take."""

    device: str = "auto"
    """Where training and drawing run: cpu, cuda, cuda:1, or auto (a GPU where there is one)."""

    threads: int = Field(default=0, ge=0, le=1024)
    """CPU threads; 0 takes all cores."""

    groups_at_once: int | None = Field(default=None, ge=1, le=64)
    """Groups that are trained side by side, sharing the CPU threads; null: on a CPU as many as there are threads and
    memory for, 8 at most; on a GPU one."""

    preview_seconds: float = Field(default=20.0, ge=0)
    """Least time between two preview pictures while training; 0 draws none."""

    @field_validator("device")
    @classmethod
    def _known_device(cls, value: str) -> str:
        kind, _, index = value.partition(":")
        if kind not in ("auto", "cpu", "cuda") or (index and (kind != "cuda" or not index.isdecimal())):
            raise ValueError("must be auto, cpu, cuda or cuda:N")
        return value


class Config(Section):
    """All settings of a run."""

    capture: CaptureSection = CaptureSection()
    calibrate: CalibrateSection = CalibrateSection()
    initialize: InitializeSection = InitializeSection()
    train: TrainSection = TrainSection()
    bake: BakeSection = BakeSection()
    evaluate: EvaluateSection = EvaluateSection()
    run: RunSection = RunSection()
