"""The timeline's track: which frames it shows, mapping of columns to frames, and its image."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from v3studio.gui.drawing.palette import ACCENT as HEAD
from v3studio.gui.drawing.palette import PANEL as BACKGROUND

TRACK = (66, 69, 74)
TRACK_OTHER_GROUP = (80, 84, 90)
PAST = (46, 98, 118)
PAST_OTHER_GROUP = (54, 112, 134)

STEP = 0.8  # frames shown after a notch of the wheel, relative to before
LEAST_FRAMES = 5.0  # frames that are shown at least


@dataclass(frozen=True)
class TimelineZoom:
    """A part of the frames: the one at the left edge, with a fraction, and how many are shown; None: all."""

    first: float = 0.0
    shown: float | None = None

    def zoomed(self, notches: float, share: float, frame_count: int) -> TimelineZoom:
        """Zoom in (positive) or out. `share`: what stays where it is, 0 (left edge) to 1 (right edge)."""
        before = self.count(frame_count)
        shown = min(max(before * STEP**notches, LEAST_FRAMES), frame_count)
        if shown >= frame_count:
            return WHOLE
        return TimelineZoom(self.first + share * (before - shown), shown).within(frame_count)

    def moved(self, frames: float, frame_count: int) -> TimelineZoom:
        """Move what is shown by a number of frames."""
        return TimelineZoom(self.first + frames, self.shown).within(frame_count)

    def following(self, frame: int, frame_count: int) -> TimelineZoom:
        """The part that is shown while a frame is played: the next page, if the frame is not in view."""
        shown = self.count(frame_count)
        if self.first <= frame and frame + 1 <= self.first + shown:
            return self
        return TimelineZoom(float(frame), self.shown).within(frame_count)

    def within(self, frame_count: int) -> TimelineZoom:
        """This part, inside of the frames that there are."""
        if self.shown is None or self.shown >= frame_count:
            return WHOLE
        return TimelineZoom(min(max(self.first, 0.0), frame_count - self.shown), self.shown)

    def count(self, frame_count: int) -> float:
        """Return how many frames are shown."""
        return float(frame_count) if self.shown is None else min(self.shown, float(frame_count))


WHOLE = TimelineZoom()


@dataclass(frozen=True)
class Timeline:
    """Frames side by side on a track `width` pixels wide; their widths differ by at most a pixel. Groups alternate
    between two shades; `kept` are the frames that are not trimmed off, None for all."""

    width: int
    height: int
    frame_count: int
    group_starts: Sequence[int] = (0,)
    zoom: TimelineZoom = WHOLE
    kept: range | None = None

    def frame_at(self, x: float) -> int:
        """The frame under column x; clamped to the first and the last."""
        return min(max(int(self.zoom.first + x * self.shown / max(self.width, 1)), 0), self.frame_count - 1)

    @property
    def shown(self) -> float:
        """Return how many frames are shown."""
        return self.zoom.count(self.frame_count)

    def shows(self, frame: int) -> bool:
        """Whether a part of a frame is in view."""
        return self.zoom.first < frame + 1 and frame < self.zoom.first + self.shown

    def span(self, frame: int) -> tuple[int, int]:
        """First column of a frame and the column after its last one; at least one column where there is room."""
        left, right = (
            min(max(math.ceil((edge - self.zoom.first) * self.width / self.shown - 1e-9), 0), self.width)
            for edge in (frame, frame + 1)
        )
        return left, max(right, min(left + self.shows(frame), self.width))

    def shade(self, pixels: np.ndarray) -> None:
        """Darken the columns of frames that are trimmed off in (rows, width, 3) pixels."""
        if self.kept is None:
            return
        for columns in (slice(0, self.span(self.kept.start)[0]), slice(self.span(self.kept.stop)[0], None)):
            pixels[:, columns] = (0.3 * pixels[:, columns] + 0.7 * np.array(BACKGROUND)).astype(np.uint8)

    def picture(self, frame: int | None) -> np.ndarray:
        """(height, width, 3) uint8 RGB: groups in two shades, the played part, the current frame (None: empty)."""
        image = np.empty((self.height, self.width, 3), np.uint8)
        image[:] = BACKGROUND
        top, bottom = self.height // 4, self.height - self.height // 4
        if frame is None:
            image[top:bottom] = TRACK
            return image
        starts = [*self.group_starts, self.frame_count]
        head_left, head_right = self.span(frame)
        for group, (first, end) in enumerate(itertools.pairwise(starts)):
            left, right = self.span(first)[0], self.span(end - 1)[1]
            image[top:bottom, left:right] = TRACK_OTHER_GROUP if group % 2 else TRACK
            image[top:bottom, left : min(right, head_right)] = PAST_OTHER_GROUP if group % 2 else PAST
            if first > 0 and self.shows(first):
                image[top:bottom, left : left + 1] = BACKGROUND
        self.shade(image)
        if not self.shows(frame):
            return image
        # The playhead is at least 3 pixels wide, so that it is visible with any number of frames.
        middle = (head_left + head_right) // 2
        image[:, max(min(head_left, middle - 1), 0) : max(head_right, middle + 2)] = HEAD
        return image
