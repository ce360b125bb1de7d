"""Settings of baking: codec, quality, and which QP each attribute gets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from studio.errors import StudioError

QP_KNEE = 22
"""Above this QP the paper keeps colour, scale and rotation at it ("Compression QP Setting")."""

QP_MAX = 51
PRESETS = ("ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow")
QP_ATTRIBUTES = ("means_low", "opacities", "scales", "quats", "sh")
_HELD_AT_KNEE = ("scales", "quats", "sh")


@dataclass(frozen=True)
class BakeSettings:
    """How a group of Gaussians becomes video.

    Attributes:
        qp: H.264 quantisation parameter, 0 (lossless) to 51. Up to 22 it holds for every plane but the positions' high
            bytes, which are always lossless; above 22 colour, scale and rotation stay at 22 (paper's rule).
        attribute_qps: QPs that replace the rule, by attribute: means_low (the positions' low bytes), opacities,
            scales, quats, sh.
        codec: "h264", the only one of version 1.
        preset: x264 preset; slower ones spend fewer bytes.
        mirror_low_bytes: let the positions' low bytes run backwards where the high byte is odd, so that they do not
            jump from 255 to 0. False gives the paper's plain low byte.
        threads: channels encoded at once; 0 means one a core. It does not change the bytes.
    """

    qp: int = 20
    attribute_qps: Mapping[str, int] = field(default_factory=dict)
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
        if self.codec != "h264":
            raise StudioError(f"Baking: codec '{self.codec}' is not known; the format has 'h264' only.")
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

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready: what shapes the bytes (threads do not)."""
        values = asdict(self)
        values["attribute_qps"] = dict(sorted(self.attribute_qps.items()))
        del values["threads"]
        return values
