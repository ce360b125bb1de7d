"""ablation.json: the rate-distortion curve of each variant."""

from pipelines.takes.atomic_files import Result
from pipelines.takes.evaluation import Protocol


class RatePoint(Result):
    """A variant baked at one QP, measured after decoding."""

    qp: int
    kb_per_frame: float
    """Size of the whole stream per frame; 1 KB is 1000 bytes."""

    psnr_decoded: float
    psnr_trained: float | None = None
    ssim_decoded: float | None = None
    lpips_decoded: float | None = None


class VariantResult(Result):
    """One variant."""

    name: str
    title: str

    settings: str = ""
    """Digest of its settings; points measured with other settings are discarded."""

    points: tuple[RatePoint, ...] = ()
    """In ascending order of QP."""

    bd_rate_percent: float | None = None
    """Mean size difference from the first variant at equal PSNR; negative means smaller. None if the curves do not
    overlap; not set for the first variant."""

    bd_psnr_db: float | None = None
    """Mean PSNR difference from the first variant at equal size."""


class AblationResults(Result):
    """Contents of ablation.json."""

    protocol: Protocol | None = None
    qps: tuple[int, ...] = ()
    variants: tuple[VariantResult, ...] = ()
