"""The threads of a player: fetch -> decode -> dequantize, with bounded queues between them.

A `Run` delivers frames in order from a start frame. Seeking ends the run and starts another; the state that runs share
(fetched files, the open decoder) is in `Shared`. Frames are numbered by *ticks*, which keep increasing when the stream
loops: frame = tick % frame_count.

A group that cannot be fetched or decoded is skipped and recorded in `Shared.skipped`. A run ends with an error if
nothing can be played or the server remains unreachable.
"""

from __future__ import annotations

import threading
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.playback.bounded_queue import BoundedQueue
from studio.playback.shared import Shared, Span
from studio.playback.statistics import FrameStats, SkippedGroup
from studio.stream import DecodedFrame, Rendition, SourceUnavailable

MOST_GROUPS = 64
FETCHED_GROUPS = 1  # in the queue; one more is being decoded and another fetched, so up to three are in memory
DECODED_FRAMES = 3
READY_FRAMES = 4
STARVED_AFTER = 0.5
"""Time in seconds after which a fetch is considered slow: playback then waits for it instead of dropping its frames."""

_JOIN_SECONDS = 1.0  # after this time, a hanging fetch is abandoned; its thread ends with the network timeout


@dataclass(frozen=True)
class PlayedFrame:
    """A frame ready for rendering.

    Attributes:
        run: number of preceding seeks; frames are delivered in the order of (run, tick).
        tick: number of the frame since the start of the stream, increasing through loops.
        frame: 0-based index in the stream.
        gaussians: the splats, float32 on the CPU.
        stats: cost of the frame.
    """

    run: int
    tick: int
    frame: int
    gaussians: Gaussians
    stats: FrameStats


@dataclass(frozen=True)
class _Fetched:
    start_tick: int  # of the group's first frame
    group: Rendition
    files: dict[str, bytes]
    milliseconds: float


@dataclass(frozen=True)
class _Decoded:
    tick: int
    group: Rendition
    frame: DecodedFrame
    fetch_ms: float
    decode_ms: float


class Run:
    """Frames in order from a start tick to the end of the stream, or endlessly if looping.

    Args:
        shared: reader and caches.
        start_tick: the first frame to deliver.
        loop: continue with frame 0 after the last frame. Without it, at the end of a live stream, wait for more.
        due: returns the tick to display now; frames are dropped if a later one is already due. None: every frame is
            delivered, no matter how slow the consumer is.
        number: number of the run, see `PlayedFrame.run`.
    """

    def __init__(
        self, shared: Shared, start_tick: int, loop: bool, due: Callable[[], int] | None, number: int = 0
    ) -> None:
        self.number = number
        self._shared = shared
        self._fps, self._frame_count = shared.reader.fps, shared.reader.frame_count
        self._group_count = len(shared.reader.index)
        self._start = start_tick
        self._loop = loop
        self._due = due
        self._fetched: BoundedQueue[_Fetched] = BoundedQueue(self._groups_ahead())
        self._decoded: BoundedQueue[_Decoded] = BoundedQueue(DECODED_FRAMES)
        self.ready: BoundedQueue[PlayedFrame] = BoundedQueue(READY_FRAMES)
        self.error: BaseException | None = None
        self._fetching: tuple[int, float] | None = None  # first tick of the pending fetch, and its start time
        self._unavailable = 0  # consecutive groups that the server failed to deliver
        self._decoded_until = 0  # frame after the last decoded one
        self._delivered = False
        self._delivered_tick = start_tick
        self._dropped = 0
        self._dropped_lock = threading.Lock()
        stages = (
            ("fetch", self._fetch, self._fetched),
            ("decode", self._decode, self._decoded),
            ("dequantize", self._dequantize, self.ready),
        )
        self._threads = [
            threading.Thread(target=self._guarded, args=(work, queue), name=f"playback-{name}", daemon=True)
            for name, work, queue in stages
        ]
        for thread in self._threads:
            thread.start()

    @property
    def dropped(self) -> int:
        """Number of late frames that were dropped."""
        with self._dropped_lock:
            return self._dropped

    def count_dropped(self, frames: int) -> None:
        """Add to `dropped`."""
        with self._dropped_lock:
            self._dropped += frames

    @property
    def alive(self) -> bool:
        """Whether any of its threads is running."""
        return any(thread.is_alive() for thread in self._threads)

    def stop(self) -> None:
        """Request the run to end; does not wait."""
        for queue in (self._fetched, self._decoded, self.ready):
            queue.abort()

    def join(self) -> None:
        """Wait for the threads after `stop`, except for a fetch that hangs on the network."""
        fetching, *others = self._threads
        for thread in others:
            thread.join()
        fetching.join(_JOIN_SECONDS)

    @property
    def starved_at(self) -> int | None:
        """The first tick that waits for a slow fetch; None if there is none."""
        fetching = self._fetching
        if fetching is None or time.monotonic() - fetching[1] < STARVED_AFTER:
            return None
        return fetching[0]

    def _guarded(self, work: Callable[[], None], queue: BoundedQueue) -> None:
        """Run one stage. An exception ends the run after the frames already produced."""
        try:
            work()
        except BaseException as error:
            if self.error is None:
                self.error = error
        finally:
            queue.finish()

    def _late(self, tick: int) -> bool:
        """Whether `tick` is already due, so that earlier frames need not be shown."""
        return self._due is not None and tick <= self._due()

    def _groups_ahead(self) -> int:
        """Groups in the queue. Where renditions change, as many as the rule's buffer holds."""
        rule = self._shared.rule
        if rule is None:
            return FETCHED_GROUPS
        rule.seeked()
        seconds = self._frame_count / self._fps / self._group_count
        return min(max(round(rule.target / seconds), FETCHED_GROUPS), MOST_GROUPS)

    def _groups(self) -> Iterator[tuple[int, Span]]:
        """(tick of the first frame, group) from the start frame."""
        reader = self._shared.reader
        starts, count = reader.group_starts, reader.frame_count
        lap, frame = divmod(self._start, count)
        first = bisect_right(starts, frame) - 1
        while True:
            ends = (*starts[1:], count)
            for number in range(first, len(starts)):
                yield lap * count + starts[number], Span(number, starts[number], ends[number] - starts[number])
            if self._loop:
                lap, first = lap + 1, 0
                continue
            first = len(starts)
            if not self._shared.wait_for_more(first, lambda: self._fetched.over):
                return
            index = reader.index
            starts, count = index.starts, index.manifest.frame_count

    def _buffered(self, tick: int) -> float:
        """Seconds of frames before `tick` that are not yet shown."""
        shown = self._delivered_tick if self._due is None else max(self._due(), self._start)
        return max(tick - shown, 0) / self._fps

    def _fetch(self) -> None:
        failures = 0  # consecutive
        for start_tick, span in self._groups():
            end_tick = start_tick + span.frame_count
            if self._late(end_tick):
                self.count_dropped(end_tick - max(start_tick, self._start))
                continue
            began = time.perf_counter()
            found = self._files(span, start_tick)
            milliseconds = 1e3 * (time.perf_counter() - began)
            if found is None:
                failures += 1
                if self._fetched.over:
                    return
                if failures >= self._group_count:
                    raise nothing_playable("no frame of the stream can be played", self._shared.skipped[0])
                continue
            failures = 0
            group, files = found
            if self._fetched.put(_Fetched(start_tick, group, files, milliseconds)) is None:
                return

    def _files(self, span: Span, start_tick: int) -> tuple[Rendition, dict[str, bytes]] | None:
        """The group in the chosen rendition and its files; None if they cannot be fetched, which is recorded."""
        if self._shared.is_lost(span):
            return None
        self._fetching = (max(start_tick, self._start), time.monotonic())
        try:
            group = self._shared.choose(span.index, self._buffered(start_tick))
            files = self._shared.files(group)
        except StudioError as error:
            if self._fetched.over:
                return None  # the reader was closed in the meantime; the group may be intact
            self._shared.note_damage(span, span.first_frame, span.end_frame, error.message)
            self._unavailable = self._unavailable + 1 if isinstance(error, SourceUnavailable) else 0
            if self._unavailable == 2:
                raise  # twice in a row: the server is unreachable, not just a file
            return None
        finally:
            self._fetching = None
        self._unavailable = 0
        self._shared.note_intact(group)
        return group, files

    def _decode(self) -> None:
        with self._shared.decode_lock:
            while (fetched := self._fetched.get()) is not None:
                try:
                    if not self._decode_group(fetched):
                        return
                except StudioError as error:
                    group, decoded = fetched.group, self._decoded_until
                    self._shared.note_damage(group, max(group.first_frame, decoded), group.end_frame, error.message)

    def _decode_group(self, fetched: _Fetched) -> bool:
        """Decode one group, starting at the required frame; False if the run is over."""
        shared, group = self._shared, fetched.group
        end_tick = fetched.start_tick + group.frame_count
        first = max(fetched.start_tick, self._start)
        self._decoded_until = group.first_frame
        began = time.perf_counter()
        decoder = shared.decoder
        wanted = group.first_frame + first - fetched.start_tick
        if decoder is None or decoder.group is not group or decoder.next_frame > wanted:
            shared.close_decoder()
            decoder = shared.decoder = shared.reader.open_group(group, fetched.files)
        try:
            while decoder.next_frame < group.end_frame:
                tick = fetched.start_tick + decoder.next_frame - group.first_frame
                # the next group is already due and has been fetched: continue with it
                if self._late(end_tick) and self._fetched.peek() is not None:
                    self.count_dropped(end_tick - max(tick, first))
                    break
                frame = decoder.read()
                self._decoded_until = decoder.next_frame
                if tick < first:
                    if self._decoded.over:  # seeking: a newer run may be waiting for the lock
                        return False
                    continue
                now = time.perf_counter()
                share = fetched.milliseconds / group.frame_count
                if self._decoded.put(_Decoded(tick, group, frame, share, 1e3 * (now - began))) is None:
                    return False
                began = time.perf_counter()
        except BaseException:
            shared.close_decoder()
            raise
        return True

    def _frame(self, tick: int) -> int:
        """Index of the frame of a tick. While a stream is live and the count of frames grows, there are no loops."""
        return tick % self._frame_count if self._loop else tick

    def _dequantize(self) -> None:
        while (decoded := self._decoded.get()) is not None:
            following = self._decoded.peek()
            if following is not None and self._late(following.tick):
                self.count_dropped(1)
                self._shared.played(decoded.group, dropped=1)
                continue
            group, frame = decoded.group, self._frame(decoded.tick)
            began = time.perf_counter()
            try:
                gaussians = decoded.frame.gaussians()
            except StudioError as error:
                self._shared.note_damage(group, frame, frame + 1, error.message)
                continue
            milliseconds = 1e3 * (time.perf_counter() - began)
            stats = FrameStats(
                frame, group.index, group.bytes / group.frame_count, decoded.fetch_ms, decoded.decode_ms, milliseconds
            )
            item = PlayedFrame(self.number, decoded.tick, frame, gaussians, stats)
            dropped = self.ready.put(item, (lambda second: self._late(second.tick)) if self._due else None)
            if dropped is None:
                return
            self._delivered = True
            self._delivered_tick = decoded.tick
            self.count_dropped(dropped)
            self._shared.played(group, 1 - min(dropped, 1), min(dropped, 1))
        if not self._delivered and not self.ready.over and self.error is None and self._shared.skipped:
            frame = self._frame(self._start)
            left_out = [item for item in self._shared.skipped if item.first_frame + item.frame_count > frame]
            raise nothing_playable(f"no frame at or after frame {frame} can be played", left_out[0])


def nothing_playable(problem: str, skipped: SkippedGroup) -> StudioError:
    """The error for a stream, or the rest of one, without any playable frame; its cause is that of `skipped`."""
    cause = skipped.cause
    return StudioError(
        "playback.nothing_playable",
        f"{problem}; {cause.problem}",
        file=cause.file,
        fix=cause.fix,
        cause=cause.code,
        group=skipped.group,
    )


def raise_for_user(error: BaseException) -> None:
    """Raise the error that ended a run: StudioErrors unchanged, other exceptions wrapped in one."""
    if isinstance(error, StudioError):
        raise error
    raise StudioError("playback.failed", f"playback stopped ({type(error).__name__}: {error})") from error
