"""Playback without a window, for `v3studio play --headless` and for measurements."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.playback.follow import Follower
from studio.playback.pipeline import PlayedFrame, Run, raise_for_user
from studio.playback.player import Player
from studio.playback.shared import Shared
from studio.playback.statistics import FrameStats, PlaybackReport, SkippedGroup
from studio.progress import ProgressFn, no_progress
from studio.stream import Source, StreamReader
from studio.stream.group_index import no_such_frame


def play_headless(
    stream: StreamReader | Path | str | Source,
    *,
    realtime: bool = False,
    start_frame: int = 0,
    frame_limit: int | None = None,
    on_frame: Callable[[PlayedFrame], None] | None = None,
    render: Callable[[Gaussians], object] | None = None,
    progress: ProgressFn = no_progress,
    adaptive: bool | None = None,
) -> PlaybackReport:
    """Play a stream to its end with the threads of the player. A live stream is followed until it is complete.

    Args:
        stream: an open reader (left open), or the folder, URL or source of a stream.
        realtime: True: play at the stream's frame rate and drop late frames, as on a screen. False: play all frames as
            fast as possible.
        start_frame: index of the first frame, 0-based.
        frame_limit: number of frames to play; None: play to the end.
        on_frame: called with each frame, in order, on the caller's thread.
        render: renders a frame; its duration becomes the frame's `render_ms`.
        progress: called with played and total frames.
        adaptive: whether renditions change with network and computer, see `Shared`.

    Returns:
        cost of each delivered frame, number of dropped frames, duration, and skipped groups.

    Raises:
        StudioError: the stream cannot be opened, none of it can be played, or its server remains unreachable.
    """
    owned = not isinstance(stream, StreamReader)
    reader = stream if isinstance(stream, StreamReader) else StreamReader.open(stream)
    try:
        if not 0 <= start_frame < reader.frame_count:
            raise no_such_frame(start_frame, reader.frame_count)
        if frame_limit is not None and frame_limit < 1:
            raise StudioError(
                "playback.invalid_frame_limit",
                f"frame_limit is {frame_limit}; it must be at least 1",
                value=frame_limit,
            )
        end = sys.maxsize if reader.live else reader.frame_count
        stop = end if frame_limit is None else min(end, start_frame + frame_limit)

        def show(item: PlayedFrame) -> FrameStats:
            stats = item.stats
            if render is not None:
                began = time.perf_counter()
                render(item.gaussians)
                stats = replace(stats, render_ms=1e3 * (time.perf_counter() - began))
            if on_frame is not None:
                on_frame(item)
            return stats

        play = _play_by_clock if realtime else _play_all
        return play(reader, start_frame, stop, show, progress, adaptive)
    finally:
        if owned:
            reader.close()


def _play_all(
    reader: StreamReader,
    start: int,
    stop: int,
    show: Callable[[PlayedFrame], FrameStats],
    progress: ProgressFn,
    adaptive: bool | None,
) -> PlaybackReport:
    shared = Shared(reader, adaptive)
    began = time.perf_counter()
    follower = Follower(reader, shared.grown, shared.lost)
    run = Run(shared, start, loop=False, due=None)
    stats: list[FrameStats] = []
    try:
        while (item := run.ready.get()) is not None and item.frame < stop:
            stats.append(show(item))
            progress(item.frame + 1 - start, min(stop, reader.frame_count) - start)
            if item.frame == stop - 1:
                break
        if item is None and run.error is not None:
            raise_for_user(run.error)
        if item is None and shared.replaced is not None:
            raise shared.replaced
        seconds = time.perf_counter() - began
    finally:
        run.stop()
        shared.grown()
        follower.close()
        run.join()
        with shared.decode_lock:
            shared.close_decoder()
    return PlaybackReport(tuple(stats), 0, seconds, _within(shared.skipped, start, stop))


def _play_by_clock(
    reader: StreamReader,
    start: int,
    stop: int,
    show: Callable[[PlayedFrame], FrameStats],
    progress: ProgressFn,
    adaptive: bool | None,
) -> PlaybackReport:
    stats: list[FrameStats] = []
    began = time.perf_counter()
    with Player(reader, start_frame=start, adaptive=adaptive) as player:
        player.play()
        last = -1
        while True:
            item = player.frame()
            if item is not None and item.tick != last and item.frame < stop:
                last = item.tick
                stats.append(show(item))
                progress(item.frame + 1 - start, min(stop, reader.frame_count) - start)
            if player.finished or not player.playing or (item is not None and item.frame >= stop - 1):
                break
            time.sleep(min(0.25 / reader.fps, 0.01))
        seconds = time.perf_counter() - began
        skipped = _within(player.skipped, start, stop)
    # frames missing between those shown; the player's own count may include frames after the end
    lost = sum(1 for group in skipped for frame in _frames(group) if start <= frame <= last)
    dropped = (last + 1 - start) - len(stats) - lost if stats else 0
    return PlaybackReport(tuple(stats), dropped, seconds, skipped)


def _frames(group: SkippedGroup) -> range:
    return range(group.first_frame, group.first_frame + group.frame_count)


def _within(skipped: tuple[SkippedGroup, ...], start: int, stop: int) -> tuple[SkippedGroup, ...]:
    """The skipped groups within the played range; fetching runs ahead of it."""
    return tuple(group for group in skipped if _frames(group).stop > start and group.first_frame < stop)
