"""Settings of baking: profile, codec, quality, and the QP of each attribute."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self, get_args

from pydantic import Field, model_validator

from studio.json_types import JsonObject
from studio.settings import Affects, Conflict, Heading, Settings

QP_MAX = 51
QP_KNEE = 22
"""Above this QP the paper keeps color, scale and rotation at it ("Compression QP Setting")."""

QP = Annotated[int, Field(ge=0, le=QP_MAX)]
QpAttribute = Literal["means_low", "opacities", "scales", "quats", "sh"]
Preset = Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow"]

PRESETS: tuple[str, ...] = get_args(Preset)
QP_ATTRIBUTES: tuple[str, ...] = get_args(QpAttribute)
_HELD_AT_KNEE = ("scales", "quats", "sh")


class Rung(Settings):
    """One rung of the ladder: a rendition of the stream."""

    qp: QP
    """Quantization parameter of this rung."""

    splats: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Share of the splats that are kept: those that contribute most to what the training cameras see."""

    sh_degree: Annotated[int, Field(ge=0, le=3)] | None = None
    """Degree that spherical harmonics are cut to; null keeps the trained one."""

    finetune_iterations: Annotated[int, Field(ge=0, le=1_000_000)] = 1_000
    """With splats below 1: training steps per group in which the kept splats learn to cover what the others covered.
    0: they stay as they are."""

    @property
    def id(self) -> str:
        """Name of the rendition: qp24, qp24-splats40-sh0."""
        return "-".join(part for part in (f"qp{self.qp}", self.kept) if part)

    @property
    def kept(self) -> str:
        """Name of what is kept of each frame: splats40-sh0; empty for everything."""
        splats = "" if self.splats == 1 else f"splats{self.splats * 100:g}".replace(".", "-")
        return "-".join(part for part in (splats, "" if self.sh_degree is None else f"sh{self.sh_degree}") if part)

    @property
    def pruned(self) -> bool:
        """Whether splats are left out."""
        return self.splats < 1

    @property
    def finetuned(self) -> bool:
        """Whether the splats that are kept are trained further."""
        return self.pruned and self.finetune_iterations > 0

    @property
    def kind(self) -> tuple[float, int | None, int]:
        """What the splats of the rung depend on: rungs of one kind differ by QP only."""
        return self.splats, self.sh_degree, self.finetune_iterations if self.pruned else 0


DEFAULT_LADDER = (
    Rung(qp=16),
    Rung(qp=20),
    Rung(qp=24),
    Rung(qp=28),
    Rung(qp=24, splats=0.5, sh_degree=0),
    Rung(qp=28, splats=0.25, sh_degree=0),
)
"""What `v3studio bake --ladder` bakes: four rates of all splats, and two rungs for phones."""


_B_FRAMES = 5
"""B-frames between P-frames, unless the settings say otherwise."""


class BakeSettings(Settings):
    """How a group of Gaussians is encoded."""

    affects: ClassVar[Affects | None] = Affects("videos")

    profile: Annotated[Literal["motion", "planes"], Heading("Size and quality")] = "motion"
    """motion: block motion and one small residual video (docs/STREAM.md). planes: the paper's, one video per attribute
    component."""

    qp: QP = 20
    """Quantization parameter. 0 is lossless; higher values are smaller and coarser. Profile planes: above 22, color,
    scale and rotation stay at 22, as in the paper; the high bytes of the means are always lossless."""

    target_kb_per_frame: Annotated[float, Field(gt=0)] | None = None
    """Instead of qp: choose, per group, the lowest QP whose files take at most this many kilobytes (1000 bytes) per
    frame."""

    target_psnr: Annotated[float, Field(gt=0, le=100)] | None = None
    """Instead of qp: choose, per group, the highest QP whose decoded frames, rendered from a few cameras, reach this
    PSNR in dB against the trained frames."""

    max_loss: Annotated[float, Field(gt=0, le=10)] | None = None
    """The most PSNR in dB that encoding may cost any frame, measured as in the evaluation: against the footage of the
    held-out cameras, or of training cameras if there are none. Frames that lose more get a lower QP. Applies to the
    ladder's first rung if that keeps all splats, and requires codec h264. null: no limit."""

    codec: Annotated[Literal["h264", "hevc", "av1"], Heading("Encoding")] = "h264"
    """h264 plays on every device. hevc and av1 require profile motion."""

    attribute_qps: dict[QpAttribute, QP] = Field(default={})
    """QPs of single attributes, overriding qp; example: {opacities: 26}. means_low is the low bytes of the means in
    planes, their residuals in motion."""

    preset: Preset = "medium"
    """Encoder effort: slower presets produce smaller files."""

    b_frames: Annotated[int, Field(ge=0, le=7)] | None = None
    """Profile motion: B-frames between P-frames, each predicted from the pictures before and after it. They save a
    tenth to a quarter of the bytes. null: 5, and none with codec av1."""

    smooth_paths: bool | None = None
    """Profile motion: smooth each splat's position, rotation, size, opacity and color over the group, as strongly as
    its own path shows jitter (docs/STREAM.md). null: yes, but not with qp 0 or target_psnr, which ask for the
    trained frames as they are."""

    mirror_low_bytes: bool = True
    """Profile planes: reverse the low bytes of the means where the high byte is odd, so that they do not jump from 255
    to 0. false: plain low bytes, as in the paper."""

    ladder: Annotated[tuple[Rung, ...], Field(max_length=16), Heading("Network")] = ()
    """Renditions of the stream, the best first, each with qp, splats (share of the splats that are kept),
    sh_degree and finetune_iterations; players choose one at each group. Example: [{qp: 20}, {qp: 28}, {qp: 28, splats:
    0.5, sh_degree: 0}]. Empty: one rendition, by the settings above."""

    splats: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Share of the splats that are kept without a ladder: those that contribute most to what
    the training cameras see. They are not trained further (docs/measurements/stream.md)."""

    first_group_size: Annotated[int, Field(ge=1)] | None = None
    """Frames of the stream's first group, so that playing starts after a small download; the rest of the trained group
    becomes a group of its own. null: groups as trained."""

    view_range: Annotated[Literal["auto", "none"], Affects("manifest")] = "auto"
    """Tell players from where the splats can be looked at. auto: up to 35 to 50 degrees from the nearest training
    camera, depending on their spacing; beyond it, players fade the picture. none: from everywhere."""

    @model_validator(mode="after")
    def _combinations(self) -> Self:
        if self.ladder and (self.target_kb_per_frame is not None or self.target_psnr is not None):
            raise Conflict(
                "ladder and a target are both set",
                "Remove the target: each rung has its own qp.",
                "ladder",
                "target_kb_per_frame" if self.target_kb_per_frame is not None else "target_psnr",
            )
        if len({rung.id for rung in self.ladder}) < len(self.ladder):
            raise Conflict("two rungs of the ladder are the same", "Remove one of them.", "ladder")
        if self.codec == "av1" and any(rung.qp == 0 for rung in self.ladder):
            raise Conflict(
                "qp 0 (lossless) is not available with codec av1", "Raise the rung's qp to 1.", "codec", "ladder"
            )
        if self.target_kb_per_frame is not None and self.target_psnr is not None:
            raise Conflict(
                "target_kb_per_frame and target_psnr are both set",
                "Set one of them to null.",
                "target_kb_per_frame",
                "target_psnr",
            )
        for target in ("target_kb_per_frame", "target_psnr"):
            if self.max_loss is not None and getattr(self, target) is not None:
                raise Conflict(f"max_loss and {target} are both set", "Set one of them to null.", "max_loss", target)
        if self.max_loss is not None and self.codec != "h264":
            raise Conflict(
                "max_loss requires codec h264: the other encoders do not take the QP of single frames",
                "Set max_loss to null, or codec to h264.",
                "max_loss",
                "codec",
            )
        if self.splats < 1 and self.ladder:
            raise Conflict("splats and ladder are both set", "Set splats in the rungs.", "splats", "ladder")
        if self.b_frames and (self.profile == "planes" or self.codec == "av1"):
            raise Conflict(
                "b_frames require profile motion with codec h264 or hevc",
                "Set b_frames to null.",
                "b_frames",
                "profile" if self.profile == "planes" else "codec",
            )
        if self.smooth_paths and self.profile == "planes":
            raise Conflict(
                "smooth_paths requires profile motion", "Set smooth_paths to null.", "smooth_paths", "profile"
            )
        if self.profile == "planes" and self.codec != "h264":
            raise Conflict(
                f"codec {self.codec} requires profile motion",
                "Set profile to motion or codec to h264.",
                "codec",
                "profile",
            )
        if self.codec == "av1" and self.qp == 0:
            raise Conflict(
                "qp 0 (lossless) is not available with codec av1",
                "Set qp to 1, or codec to h264 or hevc.",
                "codec",
                "qp",
            )
        return self

    @property
    def qp_overrides(self) -> dict[str, int]:
        """`attribute_qps` by plain name."""
        return {str(name): qp for name, qp in self.attribute_qps.items()}

    def attribute_qp(self, attribute: str) -> int:
        """QP of an attribute of `QP_ATTRIBUTES`; 0 for the high bytes of the means ("means_high")."""
        if attribute == "means_high":
            return 0
        if attribute in self.qp_overrides:
            return self.qp_overrides[attribute]
        return min(self.qp, QP_KNEE) if attribute in _HELD_AT_KNEE else self.qp

    @property
    def rungs(self) -> tuple[Rung, ...]:
        """The ladder; without one, a single rung by `qp`."""
        return self.ladder or (Rung(qp=self.qp, splats=self.splats, finetune_iterations=0),)

    @property
    def b_frame_count(self) -> int:
        """B-frames between P-frames, by the settings or by default."""
        if self.codec == "av1":
            return 0
        return _B_FRAMES if self.b_frames is None else self.b_frames

    @property
    def smooths_paths(self) -> bool:
        """Whether paths are smoothed, by the settings or by default."""
        if self.smooth_paths is not None:
            return self.smooth_paths
        return self.qp > 0 and self.target_psnr is None

    def at_qp(self, qp: int) -> BakeSettings:
        """The same with another QP."""
        return self.replace(qp=qp)

    def to_dict(self) -> JsonObject:
        """JSON-ready, for the manifest. The order of keys is part of the stream's bytes."""
        ladder = {"ladder": [rung.model_dump(mode="json") for rung in self.ladder]} if self.ladder else {}
        coding: JsonObject = {}
        if self.profile == "motion":
            coding = {"b_frames": self.b_frame_count, "smooth_paths": self.smooths_paths}
        return {
            "profile": self.profile,
            "qp": self.qp,
            "attribute_qps": dict(sorted(self.attribute_qps.items())),
            "target_kb_per_frame": self.target_kb_per_frame,
            "target_psnr": self.target_psnr,
            **({"max_loss": self.max_loss} if self.max_loss is not None else {}),
            "codec": self.codec,
            "preset": self.preset,
            "mirror_low_bytes": self.mirror_low_bytes,
            **coding,
            **({"splats": self.splats} if self.splats < 1 else {}),
            **ladder,
        }
