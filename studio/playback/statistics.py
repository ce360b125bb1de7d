"""Cost of playback per frame, and its summary."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields

import numpy as np

from v3studio.studio.errors import Message
from v3studio.studio.json_types import JsonObject


@dataclass(frozen=True)
class FrameStats:
    """Cost of one frame.

    Attributes:
        frame: 0-based index in the stream.
        bytes: its share of the size of the group's files, which are fetched as a whole.
        fetch_ms: its share of the time to read the group's files and verify their SHA-256.
        decode_ms: time of video decoding; for a keyframe, including the time to open the files.
        dequantize_ms: time to convert decoded images to Gaussians.
        render_ms: time of rendering; None if the frame was not rendered.
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
    """Frames, 0-based, that could not be played because of `cause`: their group is damaged, missing or unreachable."""

    group: int
    first_frame: int
    frame_count: int
    cause: Message

    def __str__(self) -> str:
        return self.sentence(int)

    def sentence(self, number: Callable[[int], int]) -> str:
        """A sentence that says which frames were skipped and why, with the `number` of each."""
        first, last = number(self.first_frame), number(self.stop - 1)
        return f"Group {self.group}, frames {first} to {last}, was skipped: {self.cause}"

    @property
    def stop(self) -> int:
        """The frame after the last skipped one."""
        return self.first_frame + self.frame_count

    def to_dict(self) -> JsonObject:
        """JSON-ready: group, first_frame, frame_count, reason and code."""
        return {
            "group": self.group,
            "first_frame": self.first_frame,
            "frame_count": self.frame_count,
            "reason": str(self.cause),
            "code": self.cause.code,
        }


@dataclass(frozen=True)
class Spread:
    """Mean, median, 95th percentile (interpolated linearly) and maximum of a quantity."""

    mean: float
    median: float
    p95: float
    max: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """The statistics of any number of values; zeros if there are none."""
        if not values:
            return cls(0.0, 0.0, 0.0, 0.0)
        median, p95 = np.percentile(values, [50, 95])
        return cls(sum(values) / len(values), float(median), float(p95), max(values))


@dataclass(frozen=True)
class PlaybackReport:
    """Statistics of a playback: cost of each delivered frame, number of late frames that were dropped, time from the
    first request to the last frame, and damaged groups, whose frames count as neither shown nor dropped."""

    frames: tuple[FrameStats, ...]
    dropped: int
    seconds: float
    skipped: tuple[SkippedGroup, ...] = ()

    @property
    def shown(self) -> int:
        """Number of delivered frames."""
        return len(self.frames)

    @property
    def fps(self) -> float:
        """Delivered frames per second."""
        return self.shown / self.seconds if self.seconds > 0 else 0.0

    def spread(self, figure: str) -> Spread:
        """Statistics of one field of `FrameStats`: bytes, fetch_ms, decode_ms, dequantize_ms or render_ms."""
        values = [getattr(stats, figure) for stats in self.frames]
        return Spread.of([value for value in values if value is not None])

    def to_dict(self) -> JsonObject:
        """JSON-ready: the summary, then all frames."""
        figures = [field.name for field in fields(FrameStats) if field.name not in ("frame", "group")]
        if all(stats.render_ms is None for stats in self.frames):
            figures.remove("render_ms")
        return {
            "shown": self.shown,
            "dropped": self.dropped,
            "seconds": self.seconds,
            "fps": self.fps,
            "skipped": [group.to_dict() for group in self.skipped],
            "summary": {name: asdict(self.spread(name)) for name in figures},
            "frames": [asdict(stats) for stats in self.frames],
        }
