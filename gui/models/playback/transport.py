"""Transport: play, pause, step and seek. The current frame follows the sound or the clock, not the drawing rate."""

import time
from collections.abc import Callable, Sequence

from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers
from v3studio.studio.playback.sound_player import SoundPlayer


class Transport:
    """The current frame, counted from 0; people know it by `numbers`. `group_starts`: ascending."""

    def __init__(
        self,
        frame_count: int,
        fps: float,
        group_starts: Sequence[int] = (0,),
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.frame_count = frame_count
        self.fps = fps
        self.group_starts = tuple(group_starts) or (0,)
        self.loop = True
        self.numbers = FrameNumbers()
        # first and last frame of the selected span, which playback with looping repeats; None for all frames
        self.span: tuple[int, int] | None = None
        self._span_begin: int | None = None
        self._now = now
        self._playing = False
        self._speed = 1.0
        self._anchor_time = now()
        self._anchor_frame = 0
        self._leader: SoundPlayer | None = None
        self._led: int | None = None  # the leader's last frame; None while it does not lead

    @property
    def last(self) -> int:
        return self.frame_count - 1

    def number(self, frame: int) -> int:
        """The number of a frame, see `FrameNumbers`."""
        return self.numbers.number(frame)

    def range_words(self, first: int, last: int) -> str:
        """Frames in words: "Frames 62 to 70"."""
        return f"Frames {self.number(first)} to {self.number(last)}"

    @property
    def playing(self) -> bool:
        """Whether frames advance; without looping, playback stops at the last frame."""
        if self._playing and not self.loop and self._elapsed_frame() > self.last:
            self._anchor(self.last)
            self._playing = False
            self._lead()
        return self._playing

    @property
    def frame(self) -> int:
        if not self.playing:
            return self._anchor_frame
        due = self._elapsed_frame()
        if self.span is not None and self.loop and due > self.span[1]:
            return self._back_in_span(due, *self.span)
        return due % self.frame_count if self.loop else min(due, self.last)

    def select_span(self, start: int, end: int) -> None:
        """Select the frames between two, both inclusive, in any order; they are clamped to the range."""
        low, high = sorted((min(max(start, 0), self.last), min(max(end, 0), self.last)))
        self._anchor(self.frame)
        self.span, self._span_begin = (low, high), None
        self._lead()

    def clear_span(self) -> bool:
        """Select no span; returns whether there was one, or its beginning."""
        if self.span is None and self._span_begin is None:
            return False
        self._anchor(self.frame)
        self.span = self._span_begin = None
        self._lead()
        return True

    def step_span(self) -> str:
        """Set the span's beginning to the current frame, next its end, then clear it; a sentence on what was done."""
        frame = self.frame
        if self.span is not None:
            self.clear_span()
            return "No span is selected."
        if self._span_begin is None:
            self._span_begin = frame
            return f"The span begins at frame {self.number(frame)}. Go to its end and press T again."
        self.select_span(self._span_begin, frame)
        words = self.range_words(*(self.span or (frame, frame)))
        return f"{words} are selected: playback repeats them. Press T again for all."

    def _back_in_span(self, due: int, first: int, last: int) -> int:
        frame = first + (due - first) % (last - first + 1)
        if self._led is not None:  # the sound repeats as a whole: begin it again where the image is
            self._anchor(frame)
            self._lead()
        return frame

    @property
    def speed(self) -> float:
        """Playback speed; 1 is the capture's frame rate."""
        return self._speed

    @speed.setter
    def speed(self, value: float) -> None:
        self._anchor(self.frame)
        self._speed = value
        self._lead()

    def follow(self, leader: SoundPlayer | None) -> None:
        """Follow a sound while playing at speed 1 (None: the clock again)."""
        if leader is self._leader:
            return
        self._anchor(self.frame)
        if self._leader is not None:
            self._leader.stop()
        self._leader, self._led = leader, None
        self._lead()

    def _lead(self) -> None:
        """Start or stop the leader; called after every change."""
        self._led = None
        if self._leader is None:
            return
        if self._playing and self._speed == 1:
            self._led = self._anchor_frame
            self._leader.play(self._anchor_frame / self.fps, self.loop)
        else:
            self._leader.stop()

    def _elapsed_frame(self) -> int:
        if self._leader is not None and self._led is not None:
            seconds = self._leader.position()
            if seconds is not None:
                self._led = int(seconds * self.fps + 1e-6)
                return self._led
            self._anchor(self._led % self.frame_count)  # it cannot play: continue by the clock
            self._led = None
        elapsed = self._now() - self._anchor_time
        # The small term keeps a time exactly at a frame's start from rounding down to the previous frame.
        return self._anchor_frame + int(elapsed * self.fps * self._speed + 1e-6)

    def _anchor(self, frame: int) -> None:
        self._anchor_frame = min(max(int(frame), 0), self.last)
        self._anchor_time = self._now()

    def resize(self, frame_count: int, group_starts: Sequence[int], fps: float) -> None:
        """Set the range (for example when more frames have been trained); the frame and the playing state are kept."""
        frame = self.frame
        self.frame_count, self.group_starts, self.fps = max(frame_count, 1), tuple(group_starts) or (0,), fps
        if self.span is not None and self.span[1] > self.last:
            self.span = None
        if self._span_begin is not None and self._span_begin > self.last:
            self._span_begin = None
        self._anchor(frame)
        self._lead()

    def play(self) -> None:
        """Play from the current frame, or from the beginning if the end was reached."""
        if not self.playing:
            begin = 0 if self._anchor_frame >= self.last else self._anchor_frame
            if self.span is not None and not self.span[0] <= begin <= self.span[1]:
                begin = self.span[0]
            self._anchor(begin)
            self._playing = True
            self._lead()

    def pause(self) -> None:
        self._anchor(self.frame)
        self._playing = False
        self._lead()

    def toggle(self) -> None:
        if self.playing:
            self.pause()
        else:
            self.play()

    def set_loop(self, loop: bool) -> None:
        """Whether playback restarts after the last frame."""
        self._anchor(self.frame)
        self.loop = loop
        self._lead()

    def seek(self, frame: int) -> None:
        """Go to a frame, clamped to the range; playback continues from there."""
        self._anchor(frame)
        self._lead()

    def step(self, frames: int) -> None:
        """Pause and move by a number of frames, clamped to the range."""
        self.pause()
        self._anchor(self._anchor_frame + frames)

    def jump_group(self, direction: int) -> None:
        """Go to the first frame of the next group (1), or of this or the previous one (-1)."""
        frame = self.frame
        if direction > 0:
            later = [start for start in self.group_starts if start > frame]
            self.seek(later[0] if later else self.last)
        else:
            earlier = [start for start in self.group_starts if start < frame]
            self.seek(earlier[-1] if earlier else 0)
