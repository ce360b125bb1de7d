"""comparison.json: quality of several takes by one protocol."""

from __future__ import annotations

from pipelines.takes.atomic_files import Result

MEASURES = ("psnr", "psnr_color_fit", "ssim", "lpips")
"""Measures of a view, in order."""


class Measures(Result):
    """Quality of a view of a decoded frame, or the mean over views."""

    psnr: float
    """As filmed, dB; 100 for equal images."""

    psnr_color_fit: float
    """After the best 3x4 color matrix for each view, dB."""

    ssim: float
    lpips: float | None = None


class FlickerOfFrame(Result):
    """Flicker between a frame and the one before it, mean over cameras."""

    frame: int
    flicker: float
    """RMS change of the residual, in levels of 0 to 255."""

    group_border: bool
    """Whether a group begins with this frame."""


class ComparedTake(Measures):
    """One take: means over its cameras and frames."""

    name: str
    folder: str
    cameras: dict[str, Measures]

    trained_on: tuple[str, ...] = ()
    """Measured cameras that this take was trained on; its figures are then no measure of new views."""

    flicker: float | None = None
    """Mean over frames; None without two consecutive frames."""

    flicker_at_group_borders: float | None = None
    flicker_by_frame: tuple[FlickerOfFrame, ...] = ()

    total_bytes: int
    """All files that playing the best rendition takes, and the manifest."""

    stream_frames: int
    """Frames in the stream, also those that were not compared."""

    @property
    def bytes_per_frame(self) -> float:
        """`total_bytes` divided by the frames of the stream."""
        return self.total_bytes / self.stream_frames


class ComparisonProtocol(Result):
    """How the takes were measured."""

    name: str
    title: str
    cameras: tuple[str, ...]
    resolution: dict[str, tuple[int, int]]
    """Width and height in pixels by camera name."""

    background: tuple[float, float, float]
    crop: str
    truth: str
    """The take whose footage settings say what the truth is."""

    exact_masks: bool
    """Whether the truth's masks are exact ones (capture.evaluation_masks)."""

    frames: tuple[int, ...]
    mean: str = "over the views of a frame, then over frames"
    lpips: str | None = None


class Comparison(Result):
    """Contents of comparison.json."""

    protocol: ComparisonProtocol
    takes: tuple[ComparedTake, ...]
