"""ablation.json: the rate-distortion curve of each variant."""

from __future__ import annotations

from pipelines.takes.atomic_files import Result
from pipelines.takes.evaluation import Protocol


class RatePoint(Result):
    """A variant baked at one QP, measured after decoding."""

    qp: int
    kb_per_frame: float
    """1000 bytes; of the whole stream."""

    psnr_decoded: float
    psnr_trained: float | None = None
    ssim_decoded: float | None = None
    lpips_decoded: float | None = None


class VariantResult(Result):
    """One variant."""

    name: str
    title: str

    settings: str = ""
    """Digest of its settings: points measured with others are dropped."""

    points: tuple[RatePoint, ...] = ()
    """By ascending QP."""

    bd_rate_percent: float | None = None
    """Mean difference in bytes at equal PSNR from the first variant; below 0 is smaller. None if the curves do not
    overlap; not set for the first variant."""

    bd_psnr_db: float | None = None
    """Mean difference in PSNR at equal bytes from the first variant."""


class AblationResults(Result):
    """What ablation.json holds."""

    protocol: Protocol | None = None
    qps: tuple[int, ...] = ()
    variants: tuple[VariantResult, ...] = ()
