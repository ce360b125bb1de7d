"""Settings of baking: codec, quality, and which QP each attribute gets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from studio.errors import StudioError

QP_KNEE = 22
"""Above this QP the paper keeps color, scale and rotation at it ("Compression QP Setting")."""

QP_MAX = 51
PRESETS = ("ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow")
QP_ATTRIBUTES = ("means_low", "opacities", "scales", "quats", "sh")
PROFILES = ("motion", "planes")
CODECS = ("h264", "hevc", "av1")
_HELD_AT_KNEE = ("scales", "quats", "sh")


@dataclass(frozen=True)
class BakeSettings:
    """How a group of Gaussians becomes video.

    Attributes:
        profile: "motion" (blocks' motions beside one video of what is left: small) or "planes" (the paper's).
        qp: quantization parameter, 0 (lossless) to 51. In `planes`, up to 22 it holds for every plane but the
            positions' high bytes, which are always lossless; above 22 color, scale and rotation stay at 22 (paper's
            rule). In `motion` it holds for the whole picture.
        attribute_qps: QPs that replace the rule, by attribute: means_low (positions: their low bytes in `planes`, what
            motion leaves of them in `motion`), opacities, scales, quats, sh.
        target_kb_per_frame: instead of `qp`: the lowest QP at which each group's files have at most this many
            kilobytes (1000 bytes) a frame.
        target_psnr: instead of `qp`: the highest QP at which decoded frames, drawn, reach this PSNR in dB against the
            frames as trained, in each group.
        codec: "h264", which every player decodes; `motion` also takes "hevc" and "av1".
        preset: how hard the encoder tries; slower ones spend fewer bytes.
        mirror_low_bytes: let the positions' low bytes run backwards where the high byte is odd, so that they do not
            jump from 255 to 0. False gives the paper's plain low byte.
        threads: channels encoded at once; 0 means one a core. It does not change the bytes.
    """

    profile: str = "motion"
    qp: int = 20
    attribute_qps: Mapping[str, int] = field(default_factory=dict)
    target_kb_per_frame: float | None = None
    target_psnr: float | None = None
    codec: str = "h264"
    preset: str = "medium"
    mirror_low_bytes: bool = True
    threads: int = 0

    def __post_init__(self) -> None:
        for name, value in {"qp": self.qp, **self.attribute_qps}.items():
            if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= QP_MAX:
                raise StudioError(f"Baking: QP '{name}' is {value!r}; it must be a whole number from 0 to {QP_MAX}.")
        for name in self.attribute_qps:
            if name not in QP_ATTRIBUTES:
                raise StudioError(f"Baking: there is no QP for '{name}'; choose from {', '.join(QP_ATTRIBUTES)}.")
        if self.profile not in PROFILES:
            raise StudioError(f"Baking: profile '{self.profile}' is not known; choose from {', '.join(PROFILES)}.")
        if self.codec not in CODECS:
            raise StudioError(f"Baking: codec '{self.codec}' is not known; choose from {', '.join(CODECS)}.")
        if self.profile == "planes" and self.codec != "h264":
            raise StudioError(f"Baking: the profile planes is encoded as h264, not {self.codec}; choose motion.")
        if self.codec == "av1" and self.qp == 0:
            raise StudioError("Baking: QP 0 (lossless) is not written as av1; choose h264 or hevc, or QP 1.")
        for name in ("target_kb_per_frame", "target_psnr"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise StudioError(f"Baking: {name} is {value}; it must be above 0.")
        if self.target_kb_per_frame is not None and self.target_psnr is not None:
            raise StudioError("Baking: both target_kb_per_frame and target_psnr are set; give one of them.")
        if self.preset not in PRESETS:
            raise StudioError(f"Baking: preset '{self.preset}' is not known; choose from {', '.join(PRESETS)}.")
        if self.threads < 0:
            raise StudioError(f"Baking: threads is {self.threads}; give 0 (one a core) or more.")

    def attribute_qp(self, attribute: str) -> int:
        """QP of an attribute of `QP_ATTRIBUTES`; the positions' high bytes ("means_high") always have 0."""
        if attribute == "means_high":
            return 0
        if attribute in self.attribute_qps:
            return self.attribute_qps[attribute]
        return min(self.qp, QP_KNEE) if attribute in _HELD_AT_KNEE else self.qp

    def at_qp(self, qp: int) -> BakeSettings:
        """The same with another QP."""
        return replace(self, qp=qp)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready: what shapes the bytes (threads do not)."""
        values = asdict(self)
        values["attribute_qps"] = dict(sorted(self.attribute_qps.items()))
        del values["threads"]
        return values
