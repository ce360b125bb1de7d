"""Settings of baking: quality, and the QP of each attribute."""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from v3studio.studio.json_types import JsonObject
from v3studio.studio.settings import Affects, Conflict, Empty, Heading, Settings, Unbounded
from v3studio.studio.stream.attributes import QpAttribute

Preset = Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow"]

QP_MAX = 51  # of H.264

QP = Annotated[int, Field(ge=0, le=QP_MAX)]

LEVELS = {"draft": 36.0, "good": 39.0, "fine": 42.0, "transparent": 45.0}
"""PSNR that levels of quality promise, dB: of decoded frames rendered from training cameras, against the trained ones.
Each halves the squared error of the one before (docs/measurements/stream.md)."""

_QUALITY = re.compile(r"(\d+(?:\.\d+)?) ?(KB|dB)")
_MOST = {"KB": 1e6, "dB": 100.0}


def _quality(value: Any) -> int | str:
    """A quality as it is stored: a QP, or text such as "42 dB"."""
    if isinstance(value, str) and value.strip().isdecimal():
        value = int(value)
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= QP_MAX:
        return value
    if isinstance(value, str) and value.strip() in LEVELS:
        return value.strip()
    match = _QUALITY.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None or not 0 < float(match[1]) <= _MOST[match[2]]:
        raise Conflict(
            f"must be a level ({', '.join(LEVELS)}), a PSNR such as 41 dB, a size such as 40 KB, or a QP from 0 to "
            f"{QP_MAX}"
        )
    return f"{float(match[1]):g} {match[2]}"


Quality = Annotated[
    int | str,
    BeforeValidator(_quality),
    Unbounded("a level, a PSNR, a size and a QP have different ranges, which the validator checks"),
]


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
        """A name for the part of each frame that the rung keeps, such as splats40-sh0; empty if it keeps everything."""
        splats = "" if self.splats == 1 else f"splats{self.splats * 100:g}".replace(".", "-")
        return "-".join(part for part in (splats, "" if self.sh_degree is None else f"sh{self.sh_degree}") if part)

    @property
    def pruned(self) -> bool:
        """Tell whether splats are left out."""
        return self.splats < 1

    @property
    def finetuned(self) -> bool:
        """Tell whether the splats that are kept are trained further."""
        return self.pruned and self.finetune_iterations > 0

    @property
    def kind(self) -> tuple[float, int | None, int]:
        """Everything that the rung's splats depend on: rungs of the same kind differ only in their QP."""
        return self.splats, self.sh_degree, self.finetune_iterations if self.pruned else 0


DEFAULT_LADDER = (
    Rung(qp=16),
    Rung(qp=20),
    Rung(qp=24),
    Rung(qp=28),
    Rung(qp=24, splats=0.5, sh_degree=0),
    Rung(qp=28, splats=0.25, sh_degree=0),
)
"""The ladder of `v3studio bake --ladder`: four rates of all splats, and two rungs for phones."""


_B_FRAMES = 5  # B-frames between P-frames, unless the settings say otherwise


class BakeSettings(Settings):
    """Settings of encoding a group of Gaussians."""

    affects: ClassVar[Affects | None] = Affects("videos")

    quality: Annotated[Quality, Heading("Size and quality")] = 22
    """Size or quality, in one of three ways. A QP (quantization parameter) from 0, lossless, to 51: higher is smaller
    and coarser. A level, draft, good, fine or transparent, or a number such as 41 dB: per group, the highest QP at
    which decoded frames have a PSNR of 36, 39, 42 or 45 dB, or that number, against the trained ones, rendered from
    training cameras. A size such as 40 KB: per group, the lowest QP at which the files take less than this many
    kilobytes (1000 bytes) per frame."""

    attribute_qps: Annotated[dict[QpAttribute, QP], Heading("Encoding"), Empty("as quality")] = Field(default={})
    """QPs of single attributes, overriding quality; example: {opacities: 26}. means is the residuals of the means,
    scales is both scale and rotation."""

    preset: Preset = "medium"
    """Encoder effort: slower presets produce smaller files."""

    b_frames: Annotated[Annotated[int, Field(ge=0, le=7)] | None, Empty("automatic")] = None
    """B-frames between P-frames, each predicted from the images before and after it. They save a tenth to a third of
    the bytes. null: 5."""

    smooth_paths: Annotated[bool | None, Empty("automatic")] = None
    """Smooth each splat's position, rotation, size, opacity and color over the group, as strongly as
    its own path shows jitter (docs/STREAM.md). null: yes, except with a quality of 0, and in groups that reach their
    level only without it."""

    ladder: Annotated[tuple[Rung, ...], Field(max_length=16), Heading("Network"), Empty("none")] = ()
    """Renditions of the stream, the best first, each with qp, splats (share of the splats that are kept),
    sh_degree and finetune_iterations; players choose one at each group. Example: [{qp: 20}, {qp: 28}, {qp: 28, splats:
    0.5, sh_degree: 0}]. Empty: one rendition, by the settings above."""

    first_group_size: Annotated[Annotated[int, Field(ge=1)] | None, Empty("automatic")] = None
    """Frames of the stream's first group, so that playing starts after a small download; the rest of the trained group
    becomes a group of its own. null: groups as trained."""

    view_range: Annotated[Literal["auto", "none"], Affects("manifest")] = "auto"
    """Tell players from where the splats can be looked at. auto: up to 35 to 50 degrees from the nearest training
    camera, depending on their spacing; beyond it, players fade the image. none: from everywhere."""

    @model_validator(mode="after")
    def _combinations(self) -> Self:
        if self.ladder and (self.target_kb_per_frame is not None or self.target_psnr is not None):
            problem = f"each rung of the ladder has its own qp, but quality is {self.quality}"
            raise Conflict(problem, "Set quality to a QP.", "ladder", "quality")
        if len({rung.id for rung in self.ladder}) < len(self.ladder):
            raise Conflict("two rungs of the ladder are the same", "Remove one of them.", "ladder")
        return self

    @property
    def qp(self) -> int:
        """The QP of `quality`, or the one from which encoding starts."""
        return self.quality if isinstance(self.quality, int) else type(self)().qp

    @property
    def target_kb_per_frame(self) -> float | None:
        """Most kilobytes per frame, if `quality` is a size."""
        return self._goal("KB")

    @property
    def target_psnr(self) -> float | None:
        """Least PSNR against the trained frames, dB, if `quality` is a level or a PSNR."""
        return LEVELS.get(str(self.quality)) or self._goal("dB")

    def _goal(self, unit: str) -> float | None:
        if isinstance(self.quality, int):
            return None
        value, _, own = self.quality.partition(" ")
        return float(value) if own == unit else None

    @property
    def rungs(self) -> tuple[Rung, ...]:
        """The ladder; without one, a single rung by `qp`."""
        return self.ladder or (Rung(qp=self.qp, finetune_iterations=0),)

    @property
    def b_frame_count(self) -> int:
        """B-frames between P-frames, by the settings or by default."""
        return _B_FRAMES if self.b_frames is None else self.b_frames

    @property
    def smooths_paths(self) -> bool:
        """Tell whether paths are smoothed, by the settings or by default."""
        return self.qp > 0 if self.smooth_paths is None else self.smooth_paths

    def at_qp(self, qp: int) -> BakeSettings:
        """Return these settings with a QP as the quality."""
        return self.replace(quality=qp, smooth_paths=self.smooths_paths)

    def to_dict(self) -> JsonObject:
        """JSON-ready, for the manifest. The order of keys is part of the stream's bytes."""
        ladder = {"ladder": [rung.model_dump(mode="json") for rung in self.ladder]} if self.ladder else {}
        return {
            "qp": self.qp,
            "attribute_qps": dict(sorted(self.attribute_qps.items())),
            "target_kb_per_frame": self.target_kb_per_frame,
            "target_psnr": self.target_psnr,
            "preset": self.preset,
            "b_frames": self.b_frame_count,
            "smooth_paths": self.smooths_paths,
            **ladder,
        }
