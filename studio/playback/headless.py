"""Playing without a window: what `v3studio play --headless` does, and a way to measure a stream."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.playback.pipeline import PlayedFrame, Run, raise_for_user
from studio.playback.player import Player
from studio.playback.shared import Shared
from studio.playback.statistics import FrameStats, PlaybackReport, SkippedGroup
from studio.progress import ProgressFn, no_progress
from studio.stream import Source, StreamReader


def play_headless(
    stream: StreamReader | Path | str | Source,
    *,
    realtime: bool = False,
    start_frame: int = 0,
    frame_limit: int | None = None,
    on_frame: Callable[[PlayedFrame], None] | None = None,
    draw: Callable[[Gaussians], object] | None = None,
    progress: ProgressFn = no_progress,
) -> PlaybackReport:
    """Play a stream to its end through the player's threads.

    Args:
        stream: an open reader (left open), or a stream's folder, address or source.
        realtime: True: at the stream's frame rate, late frames dropped, as on a screen. False: every frame, as fast as
            they come.
        start_frame: 0-based.
        frame_limit: stop after this many frames of the stream; None plays to the end.
        on_frame: called with each frame, in order, on the caller's thread.
        draw: draws a frame; what it takes becomes the frame's `render_ms`.
        progress: called with frames played, of all.

    Returns:
        Cost of every frame handed out, frames dropped, seconds taken, and the damaged groups that were left out.

    Raises:
        StudioError: no stream there, nothing of it can be played, or its server stays away.
    """
    owned = not isinstance(stream, StreamReader)
    reader = stream if isinstance(stream, StreamReader) else StreamReader.open(stream)
    try:
        if not 0 <= start_frame < reader.frame_count:
            raise StudioError(f"The stream has the frames 0 to {reader.frame_count - 1}; there is none {start_frame}.")
        if frame_limit is not None and frame_limit < 1:
            raise StudioError(f"Playing: frame_limit is {frame_limit}; it must be at least 1.")
        stop = reader.frame_count if frame_limit is None else min(reader.frame_count, start_frame + frame_limit)

        def show(item: PlayedFrame) -> FrameStats:
            stats = item.stats
            if draw is not None:
                began = time.perf_counter()
                draw(item.gaussians)
                stats = replace(stats, render_ms=1e3 * (time.perf_counter() - began))
            if on_frame is not None:
                on_frame(item)
            return stats

        play = _play_by_clock if realtime else _play_all
        return play(reader, start_frame, stop, show, progress)
    finally:
        if owned:
            reader.close()


def _play_all(
    reader: StreamReader, start: int, stop: int, show: Callable[[PlayedFrame], FrameStats], progress: ProgressFn
) -> PlaybackReport:
    shared = Shared(reader)
    began = time.perf_counter()
    run = Run(shared, start, loop=False, due=None)
    stats: list[FrameStats] = []
    try:
        while (item := run.ready.get()) is not None and item.frame < stop:
            stats.append(show(item))
            progress(item.frame + 1 - start, stop - start)
            if item.frame == stop - 1:
                break
        if item is None and run.error is not None:
            raise_for_user(run.error)
        seconds = time.perf_counter() - began
    finally:
        run.stop()
        run.join()
        with shared.decode_lock:
            shared.close_decoder()
    return PlaybackReport(tuple(stats), 0, seconds, _within(shared.skipped, start, stop))


def _play_by_clock(
    reader: StreamReader, start: int, stop: int, show: Callable[[PlayedFrame], FrameStats], progress: ProgressFn
) -> PlaybackReport:
    stats: list[FrameStats] = []
    began = time.perf_counter()
    with Player(reader, start_frame=start) as player:
        player.play()
        last = -1
        while True:
            item = player.frame()
            if item is not None and item.tick != last and item.frame < stop:
                last = item.tick
                stats.append(show(item))
                progress(item.frame + 1 - start, stop - start)
            if player.finished or not player.playing or (item is not None and item.frame >= stop - 1):
                break
            time.sleep(min(0.25 / reader.fps, 0.01))
        seconds = time.perf_counter() - began
        skipped = _within(player.skipped, start, stop)
    # Frames left out between those shown; the player's own count may include some after the end.
    lost = sum(1 for group in skipped for frame in _frames(group) if start <= frame <= last)
    dropped = (last + 1 - start) - len(stats) - lost if stats else 0
    return PlaybackReport(tuple(stats), dropped, seconds, skipped)


def _frames(group: SkippedGroup) -> range:
    return range(group.first_frame, group.first_frame + group.frame_count)


def _within(skipped: tuple[SkippedGroup, ...], start: int, stop: int) -> tuple[SkippedGroup, ...]:
    """Those that concern the frames that were to be played; fetching runs ahead of them."""
    return tuple(group for group in skipped if _frames(group).stop > start and group.first_frame < stop)
