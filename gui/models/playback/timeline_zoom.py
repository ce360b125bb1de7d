"""TimelineZoom: which frames the timeline shows."""

from __future__ import annotations

from dataclasses import dataclass

STEP = 0.8  # frames shown after a notch of the wheel, relative to before
LEAST_FRAMES = 5.0  # frames that are shown at least


@dataclass(frozen=True)
class TimelineZoom:
    """A part of the frames: the one at the left edge, with a fraction, and how many are shown; None: all."""

    first: float = 0.0
    shown: float | None = None

    def zoomed(self, notches: float, share: float, frame_count: int) -> TimelineZoom:
        """Zoom in (positive) or out. `share`: what stays where it is, 0 (left edge) to 1 (right edge)."""
        before = self._shown(frame_count)
        shown = min(max(before * STEP**notches, LEAST_FRAMES), frame_count)
        if shown >= frame_count:
            return TimelineZoom()
        return TimelineZoom(self.first + share * (before - shown), shown).within(frame_count)

    def moved(self, frames: float, frame_count: int) -> TimelineZoom:
        """Move what is shown by a number of frames."""
        return TimelineZoom(self.first + frames, self.shown).within(frame_count)

    def following(self, frame: int, frame_count: int) -> TimelineZoom:
        """What is shown while a frame is played: the next page, if the frame is not in view."""
        shown = self._shown(frame_count)
        if self.first <= frame and frame + 1 <= self.first + shown:
            return self
        return TimelineZoom(float(frame), self.shown).within(frame_count)

    def within(self, frame_count: int) -> TimelineZoom:
        """This part, inside of the frames that there are."""
        if self.shown is None or self.shown >= frame_count:
            return TimelineZoom()
        return TimelineZoom(min(max(self.first, 0.0), frame_count - self.shown), self.shown)

    def _shown(self, frame_count: int) -> float:
        return float(frame_count) if self.shown is None else min(self.shown, float(frame_count))
