"""Playback without a window, for `v3studio play` and for measurements."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, nullcontext
from dataclasses import replace
from pathlib import Path

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.playback.follow import following
from studio.playback.pipeline import PlayedFrame, Run
from studio.playback.shared import Shared
from studio.playback.statistics import FrameStats, PlaybackReport
from studio.stream import Source, StreamReader

_ROUNDING = 1e-6  # in frames: makes a frame due at its time despite floating-point errors


def play_headless(
    stream: StreamReader | Path | str | Source,
    *,
    realtime: bool = False,
    start_frame: int = 0,
    frame_limit: int | None = None,
    on_frame: Callable[[PlayedFrame], None] | None = None,
    render: Callable[[Gaussians], object] | None = None,
) -> PlaybackReport:
    """Play a stream to its end: fetch, decode and dequantize on three threads. A live stream is followed until it is
    complete.

    Args:
        stream: an open reader (left open), or the folder, URL or source of a stream.
        realtime: True: play at the stream's frame rate and drop late frames, as on a screen. False: play all frames as
            fast as possible.
        start_frame: index of the first frame, 0-based.
        frame_limit: number of frames to play, at least 1; None: play to the end.
        on_frame: called with each frame, in order, on the caller's thread.
        render: renders a frame; its duration becomes the frame's `render_ms`.

    Returns:
        cost of each delivered frame, number of dropped frames, duration, and skipped groups.

    Raises:
        StudioError: the stream cannot be opened, none of it can be played, its server remains unreachable, or another
            stream took the place of a live one.
    """
    with nullcontext(stream) if isinstance(stream, StreamReader) else StreamReader.open(stream) as reader:
        reader.index.group_of(start_frame)  # an error if there is no such frame
        end = sys.maxsize if reader.live else reader.frame_count
        stop = end if frame_limit is None else min(end, start_frame + frame_limit)
        shared = Shared(reader)
        stats: list[FrameStats] = []
        began = time.perf_counter()
        with closing(_frames(shared, start_frame, realtime)) as frames:
            for item in frames:
                if item.frame >= stop:
                    break
                figures = item.stats
                if render is not None:
                    started = time.perf_counter()
                    render(item.gaussians)
                    figures = replace(figures, render_ms=1e3 * (time.perf_counter() - started))
                if on_frame is not None:
                    on_frame(item)
                stats.append(figures)
                if item.frame == stop - 1:
                    break
            seconds = time.perf_counter() - began
    skipped = tuple(group for group in shared.skipped if group.stop > start_frame and group.first_frame < stop)
    last = stats[-1].frame if stats else start_frame - 1
    lost = sum(len(range(max(group.first_frame, start_frame), min(group.stop, last + 1))) for group in skipped)
    return PlaybackReport(tuple(stats), last + 1 - start_frame - len(stats) - lost, seconds, skipped)


def _frames(shared: Shared, start: int, realtime: bool) -> Generator[PlayedFrame]:
    """The frames to show, to the end or an error. The threads run until it is closed."""
    clock = _Clock(shared.reader, start) if realtime else None
    with following(shared.reader, shared.grown, shared.lost):
        run = Run(shared, start, None if clock is None else clock.due)
        try:
            yield from iter(run.ready.get, None) if clock is None else _due_frames(run, clock)
            error = run.error or shared.replaced
            if error is not None and not isinstance(error, StudioError):
                problem = f"playback stopped ({type(error).__name__}: {error})"
                raise StudioError("playback.failed", problem) from error
            if error is not None:
                raise error
        finally:
            run.stop()
            shared.grown()
            run.join()


def _due_frames(run: Run, clock: _Clock) -> Iterator[PlayedFrame]:
    """The newest frame that is due, whenever there is one, to the end of the run."""
    while not run.ready.over:
        clock.follow(run)
        due, newest = clock.due(), None
        while (item := run.ready.peek()) is not None and item.frame <= due:
            newest = run.ready.get()
        if newest is None:
            time.sleep(clock.pause)
        else:
            yield newest


class _Clock:
    """Says which frame is due. It starts when the first frame is ready, and waits for slow fetches (a slow network, a
    server restart) and for the next group of a live stream: they cost time, not frames."""

    def __init__(self, reader: StreamReader, frame: int) -> None:
        self._reader = reader
        self._count = reader.frame_count
        self._state: tuple[int, float | None] = (frame, None)  # a frame, and since when it is due; None: it waits
        self.pause = min(0.25 / reader.fps, 0.01)

    def due(self) -> int:
        """The frame to show now, at most the last one; other threads may ask, too."""
        return min(self._elapsed(), self._count - 1)

    def _elapsed(self) -> int:
        frame, since = self._state
        return frame if since is None else frame + int((time.monotonic() - since) * self._reader.fps + _ROUNDING)

    def follow(self, run: Run) -> None:
        """Wait for the next frame where it is late for reasons other than decoding, and go on once it is ready."""
        count = self._reader.frame_count
        if self._elapsed() >= self._count and (self._reader.live or count > self._count):
            self._wait_for(self._count)
        self._count = count
        starved = run.starved_at
        if starved is not None and self.due() >= starved:
            self._wait_for(starved)
        first, (frame, since) = run.ready.peek(), self._state
        if first is not None and since is None and first.frame >= frame:  # frames in between are damaged
            self._state = (first.frame, time.monotonic())

    def _wait_for(self, frame: int) -> None:
        if self._state[1] is not None:
            self._state = (frame, None)
