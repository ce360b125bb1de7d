"""Frames at a constant rate from the presentation times of a video that skips some.

Phones and capture programs write no packet where a frame was dropped. Counting packets would shift all later frames
against the other cameras; here, the frame before the gap is shown again instead.
"""

import bisect
import itertools
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

_GAP = 0.5  # of an interval: by how much times may be off without a frame being missing
_MOST = 2.0  # frames at a constant rate per frame of the file


@dataclass(frozen=True)
class FrameClock:
    """Frames at a constant `interval`, in the unit of the times. `shown`: for each frame the index of the file's frame
    to show; None if there would be more than twice as many: the rate is not nearly constant."""

    interval: float
    shown: list[int] | None


def frame_clock(times: Sequence[int]) -> FrameClock | None:
    """The clock of a video that skips frames, by sorted times; None if all intervals are nearly equal."""
    if len(times) < 3:
        return None
    gaps = [later - earlier for earlier, later in itertools.pairwise(times)]
    usual = statistics.median(gaps)
    if max(abs(gap - usual) for gap in gaps) <= _GAP * usual:
        return None
    interval = statistics.fmean(gap for gap in gaps if abs(gap - usual) <= _GAP * usual)
    count = round((times[-1] - times[0]) / interval) + 1
    if count > _MOST * len(times):
        return FrameClock(interval, None)
    ends = [times[0] + (index + 0.5) * interval for index in range(count)]
    return FrameClock(interval, [max(0, bisect.bisect_right(times, end) - 1) for end in ends])
