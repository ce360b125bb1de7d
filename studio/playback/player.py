"""The player: a clock and the pipeline, with play, pause, seek, loop and rate. A viewport polls the current frame."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from studio.errors import StudioError
from studio.playback.clock import Clock
from studio.playback.follow import Follower
from studio.playback.pipeline import PlayedFrame, Run, raise_for_user
from studio.playback.shared import Shared
from studio.playback.sound_player import Output, SoundPlayer
from studio.playback.statistics import SkippedGroup
from studio.stream import Source, StreamReader, StreamSound
from studio.stream.group_index import no_such_frame


class Player:
    """Plays a stream at its frame rate. Thread safe.

    The clock starts when the first frame after opening or seeking is ready. Frames that are decoded too late are
    dropped, and the newest due frame is shown. The clock only waits for slow fetches (a slow network, a server
    restart). Frames are never out of order.

    A live stream is followed: at the end of what there is of it, the clock waits for the next group, and looping begins
    when it is complete. If another stream takes its place, `frame` raises `stream.live_changed` at the end.

    Damaged groups are skipped: the previous frame remains on screen for their duration, then playback continues. See
    `skipped`.

    Args:
        stream: an open reader (left open by `close`), or the folder, URL or source of a stream.
        loop: start over at the end.
        rate: playback speed, above 0 and at most 100; 1 is the stream's frame rate.
        start_frame: index of the first frame, 0-based.
        now: returns the time in seconds; for tests.
        adaptive: whether renditions change with network and computer, see `Shared`.
        output: where to play the stream's sound, such as a `SoundDevice`; the frames then follow the sound, at rate 1.
            None: silent.

    Attributes:
        sound: mute, volume, and why nothing is heard; None if silent.

    Raises:
        StudioError: the stream cannot be opened, there is no such frame, or the rate is out of range
            (playback.invalid_rate).
    """

    # Lock order: player, queue, clock.

    def __init__(
        self,
        stream: StreamReader | Path | str | Source,
        *,
        loop: bool = False,
        rate: float = 1.0,
        start_frame: int = 0,
        now: Callable[[], float] = time.monotonic,
        adaptive: bool | None = None,
        output: Output | None = None,
    ) -> None:
        self._owned = not isinstance(stream, StreamReader)
        self.reader = stream if isinstance(stream, StreamReader) else StreamReader.open(stream)
        self._lock = threading.RLock()
        self._shared = Shared(self.reader, adaptive)
        self._current: PlayedFrame | None = None
        self._dropped_before = 0
        self._runs = 0
        self._retired: list[Run] = []
        self._closed = False
        self._pcm: StreamSound | None = None
        self.sound: SoundPlayer | None = None
        self._loop = loop
        try:
            looping = loop and not self.reader.live
            self._pcm = self.reader.sound() if output is not None else None
            if output is not None and self._pcm is not None:
                self.sound = SoundPlayer(self._pcm, self.reader.frame_count / self.reader.fps, output)
            self._clock = Clock(
                self.reader.fps, self.reader.frame_count, looping, _checked_rate(rate), now, leader=self.sound
            )
            self._run = self._begin(start_frame)
            self._follower = Follower(self.reader, self._shared.grown, self._shared.lost)
        except BaseException:
            if self._owned:
                self.reader.close()
            raise

    def _begin(self, frame: int) -> Run:
        last = self.reader.frame_count - 1
        if not 0 <= frame <= last:
            raise no_such_frame(frame, last + 1)
        self._clock.cue(frame)
        number, self._runs = self._runs, self._runs + 1
        return Run(self._shared, frame, self._clock.loop, self._clock.due, number)

    # Controls

    def play(self) -> None:
        """Start or resume playback; at the end, start over."""
        with self._lock:
            if self.finished:
                self.seek(0)
            self._clock.playing = True

    def pause(self) -> None:
        """Pause the clock."""
        with self._lock:
            self._clock.playing = False

    def seek(self, frame: int) -> None:
        """Go to a frame without changing whether it plays. The current frame is shown until the new one is ready.

        Raises:
            StudioError: there is no such frame.
        """
        with self._lock:
            if self._closed:
                return
            old = self._run
            self._run = self._begin(frame)
            self._dropped_before += old.dropped
            old.stop()
            self._retired = [run for run in [*self._retired, old] if run.alive]

    def set_rate(self, rate: float) -> None:
        """Change the playback speed. Raises StudioError unless 0 < rate <= 100."""
        self._clock.rate = _checked_rate(rate)

    def seek_live(self) -> None:
        """Go to the newest group of a live stream."""
        self.seek(self.reader.group_starts[-1])

    def set_loop(self, loop: bool) -> None:
        """Change whether playback starts over at the end, or, of a live stream, when it is complete."""
        with self._lock:
            self._loop = loop
            looping = loop and not self.reader.live
            if looping != self._clock.loop:
                position = self.position
                self._clock.loop = looping
                self.seek(position)

    # State

    def frame(self) -> PlayedFrame | None:
        """The frame to show now: the same object until a newer one is due; None before the first frame is ready.

        Raises:
            StudioError: no further frame can be played, or the server is unreachable; playback has stopped.
        """
        with self._lock:
            self._follow()
            run = self._run
            starved_at = run.starved_at
            if starved_at is not None and self._clock.due() >= starved_at:
                self._clock.hold(starved_at)
            first = run.ready.peek()
            if first is not None:
                self._clock.frame_is_ready(first.tick)
            elif run.ready.over and run.error is None:
                self._clock.nothing_will_come()
            due = self._clock.due()
            taken = run.ready.take_while(lambda item: item.tick <= due)
            if taken:
                run.count_dropped(len(taken) - 1)
                self._current = taken[-1]
            elif run.error is not None and run.ready.over:
                self._clock.playing = False
                raise_for_user(run.error)
            if self.finished:
                if self._shared.replaced is not None:
                    self._clock.playing = False
                    raise self._shared.replaced
                if self._loop and self._clock.playing:  # it was live, and is complete now
                    self._clock.loop = True
                    self.seek(0)
                else:
                    self._clock.playing = False
            return self._current

    def _follow(self) -> None:
        """At the end of what there is of a live stream, the clock waits for the next group."""
        count = self.reader.frame_count
        known = self._clock.frame_count
        if (self.reader.live or count != known) and self._clock.at_end and self._shared.replaced is None:
            self._clock.hold(known)
        if count != known:
            self._clock.extend(count)

    @property
    def playing(self) -> bool:
        """Whether the clock is running, or will run as soon as the first frame is ready."""
        return self._clock.playing

    @property
    def buffering(self) -> bool:
        """Whether `frame` has yet to return the first frame after opening or seeking, or a fetch is slow."""
        return self._clock.waiting

    @property
    def loop(self) -> bool:
        """Whether playback starts over at the end."""
        return self._loop

    @property
    def live(self) -> bool:
        """Whether the stream still grows; at its end, playback waits for the next group."""
        return self.reader.live

    @property
    def rate(self) -> float:
        """Playback speed; 1 is the stream's frame rate."""
        return self._clock.rate

    @property
    def position(self) -> int:
        """The frame at the clock's position, which may be ahead of the one returned by `frame`."""
        return self._clock.due() % self.reader.frame_count

    @property
    def finished(self) -> bool:
        """Whether the duration of the last frame is over and nothing follows."""
        with self._lock:
            return self._clock.at_end and self._run.ready.over

    @property
    def dropped(self) -> int:
        """Number of late frames dropped so far."""
        with self._lock:
            return self._dropped_before + self._run.dropped

    @property
    def skipped(self) -> tuple[SkippedGroup, ...]:
        """Damaged groups skipped so far."""
        return self._shared.skipped

    def close(self) -> None:
        """End all threads; close the reader if the player opened it."""
        with self._lock:
            self._closed = True
            self._clock.playing = False
            runs = [*self._retired, self._run]
            if self.sound is not None:
                self.sound.close()
            for run in runs:
                run.stop()
            self._shared.grown()
        if self._owned:
            self.reader.end_reads()
        self._follower.close()
        for run in runs:
            run.join()
        with self._shared.decode_lock:
            self._shared.close_decoder()
        if self._pcm is not None:
            self._pcm.close()
        if self._owned:
            self.reader.close()

    def __enter__(self) -> Player:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _checked_rate(rate: float) -> float:
    if not 0 < rate <= 100:
        raise StudioError("playback.invalid_rate", f"rate is {rate}; it must be above 0 and at most 100", value=rate)
    return float(rate)
