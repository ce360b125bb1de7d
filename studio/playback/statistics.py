"""What playing cost: per frame, and summed up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any


@dataclass(frozen=True)
class FrameStats:
    """Cost of one frame.

    Attributes:
        frame: 0-based index in the stream.
        group: its group.
        bytes: its share of the group's files (files are fetched whole, a group at a time).
        fetch_ms: its share of reading the group's files and checking their SHA-256.
        decode_ms: video to planes; a keyframe's includes opening the group's files.
        dequantize_ms: planes to float attribute arrays.
        render_ms: drawing it; None where nobody drew.
    """

    frame: int
    group: int
    bytes: float
    fetch_ms: float
    decode_ms: float
    dequantize_ms: float
    render_ms: float | None = None


@dataclass(frozen=True)
class SkippedGroup:
    """Frames that could not be played because their group is damaged, missing or out of reach.

    Attributes:
        group: its index.
        first_frame, frame_count: 0-based; the frames of it that were left out.
        reason: a sentence that names the file and what is wrong with it.
    """

    group: int
    first_frame: int
    frame_count: int
    reason: str

    def __str__(self) -> str:
        last = self.first_frame + self.frame_count - 1
        return f"Group {self.group}, frames {self.first_frame} to {last}, was left out: {self.reason}"


@dataclass(frozen=True)
class Spread:
    """Mean, median, 95th percentile and maximum of one figure."""

    mean: float
    median: float
    p95: float
    max: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Of any number of values; zeros of none."""
        if not values:
            return cls(0.0, 0.0, 0.0, 0.0)
        ordered = sorted(values)

        def at(share: float) -> float:
            return ordered[min(len(ordered) - 1, int(share * len(ordered)))]

        return cls(sum(ordered) / len(ordered), at(0.5), at(0.95), ordered[-1])


@dataclass(frozen=True)
class PlaybackReport:
    """A whole run.

    Attributes:
        frames: of each frame that was handed out, in order.
        shown: how many that were.
        dropped: frames that were late and left out.
        seconds: from the first request to the last frame.
        skipped: damaged groups that playing went past; their frames are neither shown nor dropped.
    """

    frames: tuple[FrameStats, ...]
    dropped: int
    seconds: float
    skipped: tuple[SkippedGroup, ...] = ()

    @property
    def shown(self) -> int:
        """Frames handed out."""
        return len(self.frames)

    @property
    def fps(self) -> float:
        """Frames handed out a second."""
        return self.shown / self.seconds if self.seconds > 0 else 0.0

    def spread(self, figure: str) -> Spread:
        """Of one field of `FrameStats`: bytes, fetch_ms, decode_ms, dequantize_ms or render_ms."""
        values = [getattr(stats, figure) for stats in self.frames]
        return Spread.of([value for value in values if value is not None])

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready: the summary, then every frame."""
        figures = [field.name for field in fields(FrameStats) if field.name not in ("frame", "group")]
        if all(stats.render_ms is None for stats in self.frames):
            figures.remove("render_ms")
        return {
            "shown": self.shown,
            "dropped": self.dropped,
            "seconds": self.seconds,
            "fps": self.fps,
            "skipped": [asdict(group) for group in self.skipped],
            "summary": {name: asdict(self.spread(name)) for name in figures},
            "frames": [asdict(stats) for stats in self.frames],
        }
