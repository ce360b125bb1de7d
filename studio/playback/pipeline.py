"""The threads of playback: fetch -> decode -> dequantize, with bounded queues between them.

A group that cannot be fetched or decoded is skipped and recorded in `Shared.skipped`. A run ends with an error if
nothing can be played or the server remains unreachable.
"""

import threading
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import closing
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
    """A frame ready for rendering: its 0-based index in the stream, splats (float32 on the CPU), and cost."""

    frame: int
    gaussians: Gaussians
    stats: FrameStats


@dataclass(frozen=True)
class _Fetched:
    group: Rendition
    files: dict[str, bytes]
    milliseconds: float


@dataclass(frozen=True)
class _Decoded:
    number: int  # of the frame, 0-based
    group: Rendition
    frame: DecodedFrame
    fetch_ms: float
    decode_ms: float


class Run:
    """Frames in order from a start frame to the end of the stream; at the end of a live one, it waits for more. `due`
    returns the frame to display now; frames are dropped if a later one is already due. None: every frame is delivered,
    no matter how slow the consumer is."""

    def __init__(self, shared: Shared, start: int, due: Callable[[], int] | None) -> None:
        self._shared = shared
        self._start = start
        self._due = due
        self._fetched: BoundedQueue[_Fetched] = BoundedQueue(self._groups_ahead())
        self._decoded: BoundedQueue[_Decoded] = BoundedQueue(DECODED_FRAMES)
        self.ready: BoundedQueue[PlayedFrame] = BoundedQueue(READY_FRAMES)
        self.error: BaseException | None = None
        self._fetching: tuple[int, float] | None = None  # first frame of the pending fetch, and its start time
        self._unavailable = 0  # consecutive groups that the server failed to deliver
        self._decoded_until = 0  # frame after the last decoded one
        self._delivered: int | None = None  # the last delivered frame
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
        """The first frame that waits for a slow fetch; None if there is none."""
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

    def _late(self, frame: int) -> bool:
        """Whether `frame` is already due, so that earlier frames need not be shown."""
        return self._due is not None and frame <= self._due()

    def _groups_ahead(self) -> int:
        """Groups in the queue. Where renditions change, as many as the rule's buffer holds."""
        rule, reader = self._shared.rule, self._shared.reader
        if rule is None:
            return FETCHED_GROUPS
        seconds = reader.frame_count / reader.fps / len(reader.index)
        return min(max(round(rule.target / seconds), FETCHED_GROUPS), MOST_GROUPS)

    def _groups(self) -> Iterator[Span]:
        """The groups from the start frame on."""
        reader = self._shared.reader
        starts, count = reader.index.starts, reader.frame_count
        first = bisect_right(starts, self._start) - 1
        while True:
            ends = (*starts[1:], count)
            for number in range(first, len(starts)):
                yield Span(number, starts[number], ends[number] - starts[number])
            first = len(starts)
            if not self._shared.wait_for_more(first, lambda: self._fetched.over):
                return
            index = reader.index
            starts, count = index.starts, index.manifest.frame_count

    def _buffered(self, frame: int) -> float:
        """Seconds of frames before `frame` that are not yet shown."""
        shown = self._delivered if self._due is None else self._due()
        return max(frame - max(shown or 0, self._start), 0) / self._shared.reader.fps

    def _fetch(self) -> None:
        for span in self._groups():
            if self._late(span.end_frame):
                continue
            began = time.perf_counter()
            found = self._files(span)
            milliseconds = 1e3 * (time.perf_counter() - began)
            if found is not None and self._fetched.put(_Fetched(*found, milliseconds)) is None:
                return
            if self._fetched.over:
                return

    def _files(self, span: Span) -> tuple[Rendition, dict[str, bytes]] | None:
        """The group in the chosen rendition and its files; None if they cannot be fetched, which is recorded."""
        self._fetching = (max(span.first_frame, self._start), time.monotonic())
        try:
            group = self._shared.choose(span.index, self._buffered(span.first_frame))
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
        return group, files

    def _decode(self) -> None:
        while (fetched := self._fetched.get()) is not None:
            group = fetched.group
            self._decoded_until = group.first_frame
            try:
                if not self._decode_group(fetched):
                    return
            except StudioError as error:
                first = max(group.first_frame, self._decoded_until)
                self._shared.note_damage(group, first, group.end_frame, error.message)

    def _decode_group(self, fetched: _Fetched) -> bool:
        """Decode one group, starting at the required frame; False if the run is over."""
        group = fetched.group
        began = time.perf_counter()
        with closing(self._shared.reader.open_group(group, fetched.files)) as decoder:
            while (number := decoder.next_frame) < group.end_frame:
                # the next group is already due and has been fetched: continue with it
                if self._late(group.end_frame) and self._fetched.peek() is not None:
                    return True
                frame = decoder.read()
                self._decoded_until = decoder.next_frame
                if number < self._start:
                    continue
                now = time.perf_counter()
                share = fetched.milliseconds / group.frame_count
                if self._decoded.put(_Decoded(number, group, frame, share, 1e3 * (now - began))) is None:
                    return False
                began = time.perf_counter()
        return True

    def _dequantize(self) -> None:
        while (decoded := self._decoded.get()) is not None:
            following = self._decoded.peek()
            if following is not None and self._late(following.number):
                self._shared.played(decoded.group, dropped=1)
                continue
            group, frame = decoded.group, decoded.number
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
            item = PlayedFrame(frame, gaussians, stats)
            dropped = self.ready.put(item, (lambda second: self._late(second.frame)) if self._due else None)
            if dropped is None:
                return
            self._delivered = frame
            self._shared.played(group, 1 - min(dropped, 1), min(dropped, 1))
        if self._delivered is None and not self.ready.over and self.error is None:
            left_out = [item for item in self._shared.skipped if item.stop > self._start]
            if left_out:
                where = f"no frame at or after frame {self._start}" if self._start else "no frame of the stream"
                raise nothing_playable(f"{where} can be played", left_out[0])


def nothing_playable(problem: str, skipped: SkippedGroup) -> StudioError:
    """The error for a stream, or the rest of one, without any playable frame; its cause is that of `skipped`."""
    cause = skipped.cause
    problem, fields = f"{problem}; {cause.problem}", {"cause": cause.code, "group": skipped.group}
    return StudioError("playback.nothing_playable", problem, file=cause.file, fix=cause.fix, **fields)
