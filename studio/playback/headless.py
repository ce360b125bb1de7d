"""Playback without a window, for `v3studio play` and for measurements."""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, nullcontext
from dataclasses import replace
from pathlib import Path

from v3studio.studio.errors import StudioError
from v3studio.studio.playback.follow import following
from v3studio.studio.playback.statistics import FrameStats, PlaybackReport
from v3studio.studio.playback.stream_frames import LeftOut, PlayedFrame, StreamFrames, nothing_playable
from v3studio.studio.stream import Source, StreamReader

STARVED_AFTER = 0.5
"""Time in seconds after which a fetch is considered slow: playback then waits for it instead of dropping its frames."""

_LOOK_AGAIN = 0.05  # seconds between two looks at whether a live stream has grown
_ROUNDING = 1e-6  # in frames: makes a frame due at its time despite floating-point errors


def play_headless(
    stream: StreamReader | Path | str | Source,
    *,
    realtime: bool = False,
    start_frame: int = 0,
    frame_limit: int | None = None,
    on_frame: Callable[[PlayedFrame], object] | None = None,
) -> PlaybackReport:
    """Play a stream to its end: fetch, decode and dequantize on three threads. A live stream is followed until it is
    complete.

    Args:
        stream: an open reader (left open), or the folder, URL or source of a stream.
        realtime: True: play at the stream's frame rate and drop late frames, as on a screen. False: play all frames as
            fast as possible.
        start_frame: index of the first frame, 0-based.
        frame_limit: number of frames to play, at least 1; None: play to the end.
        on_frame: called with each frame, in order, on the caller's thread; the time it takes becomes `render_ms`.

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
        stats: list[FrameStats] = []
        began = time.perf_counter()
        with following(reader) as lost, closing(StreamFrames(reader)) as frames:
            for item in _in_order(frames, reader, start_frame, realtime, lost):
                if item.frame >= stop:
                    break
                figures = item.stats
                if on_frame is not None:
                    started = time.perf_counter()
                    on_frame(item)
                    figures = replace(figures, render_ms=1e3 * (time.perf_counter() - started))
                stats.append(figures)
                if item.frame == stop - 1:
                    break
            seconds = time.perf_counter() - began
    skipped = tuple(group for group in frames.skipped if group.stop > start_frame and group.first_frame < stop)
    last = stats[-1].frame if stats else start_frame - 1
    damaged = sum(len(range(max(group.first_frame, start_frame), min(group.stop, last + 1))) for group in skipped)
    return PlaybackReport(tuple(stats), last + 1 - start_frame - len(stats) - damaged, seconds, skipped)


def _in_order(
    frames: StreamFrames, reader: StreamReader, start: int, realtime: bool, lost: Sequence[StudioError]
) -> Iterator[PlayedFrame]:
    """The frames to show, to the end or an error.

    The clock starts when the first frame is ready. It waits for slow fetches (a slow network, a server restart) and for
    the next group of a live stream: they cost time, not frames.
    """
    shown, count = start - 1, reader.frame_count
    clock: tuple[int, float] | None = None  # a frame, and since when it is due; None: it waits for the next one
    played = False
    while shown + 1 < count or _grown(reader, count, lost):
        due = shown + 1
        if clock is not None:
            due = clock[0] + int((time.monotonic() - clock[1]) * reader.fps + _ROUNDING)
        if shown + 1 >= count:
            count = reader.frame_count
            if due > shown:
                clock, due = None, shown + 1
        due = min(due, count - 1)
        if due <= shown:
            time.sleep(min(0.25 / reader.fps, 0.01))
            continue
        asked = time.monotonic()
        try:
            item = frames.get(due, shown)
        except LeftOut as error:
            shown = error.stop - 1
            if time.monotonic() - asked > STARVED_AFTER:
                clock = None
            continue
        starved = item.fetched.seconds > STARVED_AFTER and item.fetched.at > asked
        if realtime and (clock is None or starved):
            clock = (item.frame, time.monotonic())
        yield item
        shown, played = item.frame, True
    if lost:
        raise lost[0]
    if not played and frames.skipped:
        raise nothing_playable(f"no frame at or after frame {start} can be played", frames.skipped[0])


def _grown(reader: StreamReader, count: int, lost: Sequence[StudioError]) -> bool:
    """Wait until a live stream has more than `count` frames; False if it is complete or was replaced by another one."""
    while reader.live and not lost and reader.frame_count <= count:
        time.sleep(_LOOK_AGAIN)
    return reader.frame_count > count
