"""The timeline's track: mapping of columns to frames, and its image."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gui.drawing.palette import ACCENT as HEAD
from gui.drawing.palette import PANEL as BACKGROUND

TRACK = (66, 69, 74)
TRACK_OTHER_GROUP = (80, 84, 90)
PAST = (46, 98, 118)
PAST_OTHER_GROUP = (54, 112, 134)


@dataclass(frozen=True)
class Timeline:
    """Frames side by side on a track `width` pixels wide; their widths differ by at most a pixel. Groups alternate
    between two shades; `first` and `shown` are the part that is shown, see `TimelineZoom`; `kept` are the frames that
    are not trimmed off, None for all."""

    width: int
    height: int
    frame_count: int
    group_starts: Sequence[int] = (0,)
    first: float = 0.0
    shown: float | None = None
    kept: range | None = None

    def frame_at(self, x: float) -> int:
        """The frame under column x; clamped to the first and the last."""
        return min(max(int(self.first + x * self._shown / max(self.width, 1)), 0), self.frame_count - 1)

    @property
    def _shown(self) -> float:
        return self.frame_count if self.shown is None else self.shown

    def shows(self, frame: int) -> bool:
        """Whether a part of a frame is in view."""
        return self.first < frame + 1 and frame < self.first + self._shown

    def span(self, frame: int) -> tuple[int, int]:
        """First column of a frame and the column after its last one; at least one column where there is room."""
        left, right = (
            min(max(math.ceil((one - self.first) * self.width / self._shown - 1e-9), 0), self.width)
            for one in (frame, frame + 1)
        )
        return left, max(right, min(left + self.shows(frame), self.width))

    def shade(self, pixels: np.ndarray) -> None:
        """Darken the columns of frames that are trimmed off in (rows, width, 3) pixels."""
        if self.kept is None:
            return
        for columns in (slice(0, self.span(self.kept.start)[0]), slice(self.span(self.kept.stop)[0], None)):
            pixels[:, columns] = (0.3 * pixels[:, columns] + 0.7 * np.array(BACKGROUND)).astype(np.uint8)

    def group_of(self, frame: int) -> int:
        return max(sum(1 for start in self.group_starts if start <= frame) - 1, 0)

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
