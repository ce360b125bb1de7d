"""The threads of a player: fetch -> decode -> dequantize, with bounded lanes between them.

A `Run` delivers frames in order from one start frame. Seeking ends the run and begins another; what both can use
(files that were fetched, the open decoder) lies in `Shared`. Frames are numbered by *ticks*, which go on rising when
the stream loops: frame = tick % frame_count.

A group that cannot be had or decoded is left out, noted (`Shared.skipped`), and the run goes on with the next; it ends
with an error where nothing at all can be played, or the server stays away.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.playback.bounded_queue import BoundedQueue
from studio.playback.shared import Shared
from studio.playback.statistics import FrameStats
from studio.stream import DecodedFrame, GroupEntry, SourceUnavailable

FETCHED_GROUPS = 1  # waiting; with one being decoded and one being fetched, up to three are in memory
DECODED_FRAMES = 3
READY_FRAMES = 4
STARVED_AFTER = 0.5
"""Seconds that fetching a group may take before whoever waits for it is said to be starved."""

_JOIN_SECONDS = 1.0  # a fetch that hangs in the network is left behind; its thread dies with its time limit


@dataclass(frozen=True)
class PlayedFrame:
    """A frame, ready to be drawn.

    Attributes:
        run: how often was sought before it; frames come in the order of (run, tick).
        tick: its number since the start of the stream, rising on through loops.
        frame: 0-based index in the stream.
        gaussians: float32, CPU.
        stats: what it cost.
    """

    run: int
    tick: int
    frame: int
    gaussians: Gaussians
    stats: FrameStats


@dataclass(frozen=True)
class _Fetched:
    start_tick: int  # of the group's first frame
    group: GroupEntry
    files: dict[str, bytes]
    milliseconds: float


@dataclass(frozen=True)
class _Decoded:
    tick: int
    group: GroupEntry
    frame: DecodedFrame
    fetch_ms: float
    decode_ms: float


class Run:
    """Frames in order from a start tick, until the end of the stream or, looping, for ever.

    Args:
        shared: reader and caches.
        start_tick: the first frame to deliver.
        loop: begin again after the last frame.
        due: the tick that should be on screen now; frames that a later due one can replace are dropped. None: every
            frame is delivered, however long the consumer takes.
        number: of the run, for `PlayedFrame.run`.
    """

    def __init__(
        self, shared: Shared, start_tick: int, loop: bool, due: Callable[[], int] | None, number: int = 0
    ) -> None:
        self.number = number
        self._shared = shared
        self._manifest = shared.reader.manifest
        self._start = start_tick
        self._loop = loop
        self._due = due
        self._fetched: BoundedQueue[_Fetched] = BoundedQueue(FETCHED_GROUPS)
        self._decoded: BoundedQueue[_Decoded] = BoundedQueue(DECODED_FRAMES)
        self.ready: BoundedQueue[PlayedFrame] = BoundedQueue(READY_FRAMES)
        self.error: BaseException | None = None
        self._fetching: tuple[int, float] | None = None  # tick from which frames are waited for, and since when
        self._unavailable = 0  # groups in a row that the server did not give
        self._decoded_until = 0  # frame after the last one that was decoded
        self._delivered = False
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
        """Frames left out because they were late."""
        with self._dropped_lock:
            return self._dropped

    def count_dropped(self, frames: int) -> None:
        """Add to `dropped`."""
        with self._dropped_lock:
            self._dropped += frames

    @property
    def alive(self) -> bool:
        """True while one of its threads runs."""
        return any(thread.is_alive() for thread in self._threads)

    def stop(self) -> None:
        """End the run soon; does not wait."""
        for queue in (self._fetched, self._decoded, self.ready):
            queue.abort()

    def join(self) -> None:
        """Wait until the threads have ended (after `stop`); a fetch that hangs in the network is not waited for."""
        fetching, *others = self._threads
        for thread in others:
            thread.join()
        fetching.join(_JOIN_SECONDS)

    @property
    def starved_at(self) -> int | None:
        """The tick from which on frames wait for a fetch that takes unusually long; None where none does."""
        fetching = self._fetching
        if fetching is None or time.monotonic() - fetching[1] < STARVED_AFTER:
            return None
        return fetching[0]

    def _guarded(self, work: Callable[[], None], queue: BoundedQueue) -> None:
        """Run one stage; whatever it raises ends the run, after the frames that were made before it."""
        try:
            work()
        except BaseException as error:
            if self.error is None:
                self.error = error
        finally:
            queue.finish()

    def _late(self, tick: int) -> bool:
        """True if `tick` is due already, so that whatever comes before it need not be shown."""
        return self._due is not None and tick <= self._due()

    def _groups(self) -> Iterator[tuple[int, GroupEntry]]:
        """(tick of the first frame, group) from the start on."""
        count = self._manifest.frame_count
        lap, frame = divmod(self._start, count)
        first = self._manifest.group_of(frame).index
        while True:
            for group in self._manifest.groups[first:]:
                yield lap * count + group.first_frame, group
            if not self._loop:
                return
            lap, first = lap + 1, 0

    def _fetch(self) -> None:
        failures = 0  # without an intact group between them
        for start_tick, group in self._groups():
            end_tick = start_tick + group.frame_count
            if self._late(end_tick):
                self.count_dropped(end_tick - max(start_tick, self._start))
                continue
            began = time.perf_counter()
            files = self._files(group, start_tick)
            milliseconds = 1e3 * (time.perf_counter() - began)
            if files is None:
                failures += 1
                if self._fetched.over:
                    return
                if failures >= len(self._manifest.groups):
                    raise StudioError(f"Nothing of the stream can be played. {self._shared.skipped[0]}")
                continue
            failures = 0
            if self._fetched.put(_Fetched(start_tick, group, files, milliseconds)) is None:
                return

    def _files(self, group: GroupEntry, start_tick: int) -> dict[str, bytes] | None:
        """The group's files; None where they cannot be had, which is then noted."""
        if self._shared.is_lost(group):
            return None
        self._fetching = (max(start_tick, self._start), time.monotonic())
        try:
            files = self._shared.files(group)
        except StudioError as error:
            if self._fetched.over:
                return None  # closed meanwhile: that says nothing about the group
            self._shared.note_damage(group, group.first_frame, group.end_frame, str(error))
            self._unavailable = self._unavailable + 1 if isinstance(error, SourceUnavailable) else 0
            if self._unavailable == 2:
                raise  # twice in a row: it is not the group, the server is gone
            return None
        finally:
            self._fetching = None
        self._unavailable = 0
        self._shared.note_intact(group)
        return files

    def _decode(self) -> None:
        with self._shared.decode_lock:
            while (fetched := self._fetched.get()) is not None:
                try:
                    if not self._decode_group(fetched):
                        return
                except StudioError as error:
                    group, decoded = fetched.group, self._decoded_until
                    self._shared.note_damage(group, max(group.first_frame, decoded), group.end_frame, str(error))

    def _decode_group(self, fetched: _Fetched) -> bool:
        """Decode one group from where it is wanted; False when the run is over."""
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
                # Behind by a whole group, and the next is here: go on there.
                if self._late(end_tick) and self._fetched.peek() is not None:
                    self.count_dropped(end_tick - max(tick, first))
                    break
                frame = decoder.read()
                self._decoded_until = decoder.next_frame
                if tick < first:
                    if self._decoded.over:  # seeking: a newer run may be waiting for its turn
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

    def _dequantize(self) -> None:
        count = self._manifest.frame_count
        while (decoded := self._decoded.get()) is not None:
            following = self._decoded.peek()
            if following is not None and self._late(following.tick):
                self.count_dropped(1)
                continue
            group, frame = decoded.group, decoded.tick % count
            began = time.perf_counter()
            try:
                gaussians = decoded.frame.gaussians()
            except StudioError as error:
                self._shared.note_damage(group, frame, frame + 1, str(error))
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
            self.count_dropped(dropped)
        if not self._delivered and not self.ready.over and self.error is None and self._shared.skipped:
            frame = self._start % count
            left_out = [item for item in self._shared.skipped if item.first_frame + item.frame_count > frame]
            raise StudioError(f"Nothing can be played from frame {frame} on. {left_out[0]}")


def raise_for_user(error: BaseException) -> None:
    """Raise what ended a run: a StudioError as it is, all else wrapped in one that says where it came from."""
    if isinstance(error, StudioError):
        raise error
    raise StudioError(f"Playing stopped: {type(error).__name__}: {error}.") from error
