"""The player's clock, which determines the frame that is due.

While holding its lock, it calls no other code than `now` and the leader, which do not wait for anything.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol

_ROUNDING = 1e-6  # in frames: makes a frame due at its time despite floating-point errors


class Leader(Protocol):
    """What the frames follow while it plays: a `SoundPlayer`."""

    def play(self, seconds: float, loop: bool) -> None:
        """Play from a time of the stream on; times beyond its end are in a later loop."""
        ...

    def stop(self) -> None:
        """Stop playing."""
        ...

    def position(self) -> float | None:
        """Time of the stream that is played now, in seconds, counted on through loops; None if it cannot play."""
        ...


class Clock:
    """Counts ticks: frames since the start of the stream, increasing through loops.

    After `cue` or `hold`, the clock is stopped at a frame until `frame_is_ready`; then it runs while playing.

    Args:
        fps: ticks per second at rate 1.
        frame_count: frames in the stream; the clock stops there unless it loops.
        loop, rate: as in `Player`.
        now: returns the time in seconds.
        leader: plays along at rate 1, and its position is then the time; at other rates it is silent.
    """

    def __init__(
        self,
        fps: float,
        frame_count: int,
        loop: bool,
        rate: float,
        now: Callable[[], float],
        leader: Leader | None = None,
    ) -> None:
        self._fps = fps
        self._frame_count = frame_count
        self._now = now
        self._lock = threading.Lock()
        self._loop = loop
        self._rate = rate
        self._playing = False
        self._waiting = True
        self._anchor_tick = 0.0  # tick at _anchor_time
        self._anchor_time = now()
        self._leader = leader
        self._led: float | None = None  # last tick of the leader; None while it does not lead

    def _read(self) -> float:
        led = self._follow() if self._playing and not self._waiting else None
        tick = self._anchor_tick if led is None else led
        if led is None and self._playing and not self._waiting:
            tick += (self._now() - self._anchor_time) * self._fps * self._rate
        return tick if self._loop else min(tick, float(self._frame_count))

    def _follow(self) -> float | None:
        """The leader's tick; None without a leader. One that fails is replaced by `now`, from its last tick on."""
        if self._leader is None or self._led is None:
            return None
        seconds = self._leader.position()
        if seconds is None:
            self._anchor(self._led)
            self._led = None
            return None
        self._led = seconds * self._fps
        return self._led

    def _anchor(self, tick: float) -> None:
        self._anchor_tick = tick
        self._anchor_time = self._now()

    def _lead(self) -> None:
        """Start or stop the leader; call it after every change."""
        if self._leader is None:
            return
        if self._playing and not self._waiting and self._rate == 1 and not self._ended:
            self._led = self._anchor_tick
            self._leader.play(self._anchor_tick / self._fps, self._loop)
        else:
            self._led = None
            self._leader.stop()

    @property
    def _ended(self) -> bool:
        return not self._loop and self._anchor_tick + _ROUNDING >= self._frame_count

    def due(self) -> int:
        """The tick to display now."""
        with self._lock:
            tick = int(self._read() + _ROUNDING)
            return tick if self._loop else min(tick, self._frame_count - 1)

    def cue(self, frame: int) -> None:
        """Stop at a frame and wait for it."""
        with self._lock:
            self._anchor(float(frame))
            self._waiting = True
            self._lead()

    def hold(self, tick: int) -> None:
        """Stop at a tick and wait for its frame, which the network has delayed."""
        with self._lock:
            if not self._waiting:
                self._anchor(float(tick))
                self._waiting = True
                self._lead()

    def frame_is_ready(self, tick: int) -> None:
        """Stop waiting if the ready frame is the expected one or a later one (frames in between are damaged)."""
        with self._lock:
            if self._waiting and tick >= int(self._anchor_tick + _ROUNDING):
                self._anchor(max(self._anchor_tick, float(tick)))
                self._waiting = False
                self._lead()

    def extend(self, frame_count: int) -> None:
        """The stream has this many frames now. Call `hold` first if the clock is at its end."""
        with self._lock:
            self._frame_count = frame_count

    def nothing_will_come(self) -> None:
        """Stop waiting and go to the end."""
        with self._lock:
            if self._waiting:
                self._anchor(float(self._frame_count))
                self._waiting = False
                self._lead()

    @property
    def frame_count(self) -> int:
        """Frames in the stream, as far as the clock knows."""
        with self._lock:
            return self._frame_count

    @property
    def waiting(self) -> bool:
        """Whether the clock is stopped between `cue` or `hold` and `frame_is_ready`."""
        with self._lock:
            return self._waiting

    @property
    def at_end(self) -> bool:
        """Whether the duration of the last frame is over."""
        with self._lock:
            return not self._loop and not self._waiting and self._read() + _ROUNDING >= self._frame_count

    @property
    def playing(self) -> bool:
        """Whether the clock is not paused."""
        with self._lock:
            return self._playing

    @playing.setter
    def playing(self, value: bool) -> None:
        with self._lock:
            if value == self._playing:
                return
            self._anchor(self._read())
            self._playing = value
            self._lead()

    @property
    def rate(self) -> float:
        """Playback speed; 1 is the stream's frame rate."""
        with self._lock:
            return self._rate

    @rate.setter
    def rate(self, value: float) -> None:
        with self._lock:
            self._anchor(self._read())
            self._rate = value
            self._lead()

    @property
    def loop(self) -> bool:
        """Whether the clock continues after the last frame. Set it immediately before `cue`."""
        with self._lock:
            return self._loop

    @loop.setter
    def loop(self, value: bool) -> None:
        with self._lock:
            self._loop = value
