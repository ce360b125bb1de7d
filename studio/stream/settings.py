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

    codec: Annotated[Literal["h264", "hevc", "av1"], Heading("Encoding")] = "h264"
    """h264 plays on every device. hevc and av1 require profile motion."""

    attribute_qps: dict[QpAttribute, QP] = Field(default={})
    """QPs of single attributes, overriding qp; example: {opacities: 26}. means_low is the low bytes of the means in
    planes, their residuals in motion."""

    preset: Preset = "medium"
    """Encoder effort: slower presets produce smaller files."""

    mirror_low_bytes: bool = True
    """Profile planes: reverse the low bytes of the means where the high byte is odd, so that they do not jump from 255
    to 0. false: plain low bytes, as in the paper."""

    @model_validator(mode="after")
    def _combinations(self) -> Self:
        if self.target_kb_per_frame is not None and self.target_psnr is not None:
            raise Conflict(
                "target_kb_per_frame and target_psnr are both set",
                "Set one of them to null.",
                "target_kb_per_frame",
                "target_psnr",
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

    def at_qp(self, qp: int) -> BakeSettings:
        """The same with another QP."""
        return self.replace(qp=qp)

    def to_dict(self) -> JsonObject:
        """JSON-ready, for the manifest. The order of keys is part of the stream's bytes."""
        return {
            "profile": self.profile,
            "qp": self.qp,
            "attribute_qps": dict(sorted(self.attribute_qps.items())),
            "target_kb_per_frame": self.target_kb_per_frame,
            "target_psnr": self.target_psnr,
            "codec": self.codec,
            "preset": self.preset,
            "mirror_low_bytes": self.mirror_low_bytes,
        }
