"""The frames of a stream, made a little ahead on three threads: fetch, decode, dequantize."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.memory_cache import MemoryCache
from v3studio.studio.playback.statistics import FrameStats, SkippedGroup
from v3studio.studio.stream import DecodedFrame, GroupDecoder, Rendition, SourceUnavailable, StreamReader

AHEAD = 4  # frames that are decoded after the wanted one
RETRY_SECONDS = 10.0  # seconds before a damaged group is tried again: it may have been fixed or uploaded

_GROUPS_AHEAD = 1  # that are fetched
_KEPT_GROUPS = 6  # groups whose files are kept besides those fetched ahead, so that scrubbing does not fetch them again
_JOIN_SECONDS = 1.0  # after this time, a hanging fetch is abandoned; its thread ends with the network timeout


class LeftOut(StudioError):
    """A frame that playback passes over: its group is damaged or missing (`playback.group_skipped`), or the take is
    trimmed (`playback.trimmed`). Others can be played. `stop`: the frame after those that are damaged with it."""

    stop = 0


@dataclass(frozen=True)
class Fetched:
    """A group and its files. `seconds`: time it took to fetch them; `at`: when that was done, by `time.monotonic`."""

    group: Rendition
    files: dict[str, bytes]
    seconds: float
    at: float


@dataclass(frozen=True)
class PlayedFrame:
    """A frame ready for rendering: its 0-based index in the stream, splats (float32 on the CPU), and cost."""

    frame: int
    gaussians: Gaussians
    stats: FrameStats
    fetched: Fetched


@dataclass(frozen=True)
class _Decoded:
    number: int  # of the frame, 0-based
    frame: DecodedFrame
    fetched: Fetched
    milliseconds: float


def bytes_of(gaussians: Gaussians) -> int:
    """Size in memory."""
    return sum(values.nbytes for _, values in gaussians.items())


class StreamFrames:
    """Frames in any order. Those after the wanted one, and the next group, are made ahead. Call `close` in the end,
    after ending the reads of a reader of one's own.

    `kept`: bytes of frames that are kept, besides a few; `loop`: whether the first frame follows the last; `finish`: a
    last step for each frame, on the third thread.
    """

    def __init__(
        self,
        reader: StreamReader,
        kept: int = 0,
        loop: bool = False,
        finish: Callable[[Gaussians], Gaussians] = lambda gaussians: gaussians,
    ) -> None:
        self._reader, self._loop, self._finish = reader, loop, finish
        self._changed = threading.Condition()
        self._wanted: tuple[int, int] | None = None  # see `get`
        self._files: MemoryCache[int, Fetched] = MemoryCache(_KEPT_GROUPS + _GROUPS_AHEAD)  # by group
        self._decoder: GroupDecoder | None = None
        self._decoded: deque[_Decoded] = deque()
        self._decoded_until = 0  # frame after the last decoded one
        self._pending: set[int] = set()  # frames that are decoded and not yet ready
        self._ready: MemoryCache[int, PlayedFrame] = MemoryCache(kept, lambda one: bytes_of(one.gaussians), AHEAD + 2)
        # by group: its error, None while it is tried again, and when it failed
        self._failed: dict[int, tuple[SkippedGroup, Exception | None, float]] = {}
        self._unavailable = 0  # consecutive groups that the server failed to deliver
        self._closed = False
        self._threads = [
            threading.Thread(target=self._run, args=stage, name=f"playback-{stage[1].__name__}", daemon=True)
            for stage in (
                (self._group_to_fetch, self._fetch),
                (self._frame_to_decode, self._decode),
                (self._frame_to_dequantize, self._dequantize),
            )
        ]
        for thread in self._threads:
            thread.start()

    def get(self, frame: int, after: int | None = None) -> PlayedFrame:
        """A frame, or the newest one before it that is ready and comes after frame `after`; waits until there is one.

        Raises LeftOut: it is damaged, and so are those before it. StudioError: no frame can be played, the server
            failed to deliver two groups in a row, or `close` was called.
        """
        self._reader.index.group_of(frame)  # an error if there is no such frame
        after = frame - 1 if after is None else after
        with self._changed:
            self._wanted = frame, after
            self._changed.notify_all()
            while not self._closed:
                held = next(filter(None, map(self._ready.get, range(frame, after, -1))), None)
                if held is not None:
                    return held
                error = self._error(frame)
                if error is None:
                    self._changed.wait()
                elif frame == after + 1:
                    raise error
                else:
                    frame -= 1
                    self._wanted = frame, after
                    self._changed.notify_all()
        raise StudioError("playback.closed", "the stream has been closed", file=self._reader.source.name)

    @property
    def skipped(self) -> tuple[SkippedGroup, ...]:
        """All groups, or parts of groups, that could not be played, in order."""
        with self._changed:
            return tuple(self._failed[group][0] for group in sorted(self._failed))

    def close(self) -> None:
        """End the threads, except for a fetch that hangs on the network."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        fetching, *others = self._threads
        for thread in others:
            thread.join()
        fetching.join(_JOIN_SECONDS)
        self._close_decoder()
        self._ready.clear()

    def _run(self, find: Callable[[], Any], work: Callable[[Any], None]) -> None:
        """Do whatever `find` finds, which holds the lock, until the end."""
        while True:
            with self._changed:
                while not self._closed and (job := find()) is None:
                    self._changed.wait()
                if self._closed:
                    return
            work(job)
            with self._changed:
                self._changed.notify_all()

    def _first(self, frame: int, after: int) -> int:
        """The frame to begin with: the first after `after` that is not known to be damaged, or if that is late and the
        group of `frame` is there, or neither is, the beginning of that group."""
        index = self._reader.index
        first = next((number for number in range(after + 1, frame) if self._error(number) is None), frame)
        group = index.group_of(frame)
        if index.starts[group] > first and (group in self._files or index.group_of(first) not in self._files):
            return index.starts[group]
        return first

    def _group_to_fetch(self) -> int | None:
        """The wanted group, or the next one that is missing; none after one that is damaged."""
        if self._wanted is None:
            return None
        index = self._reader.index
        first = index.group_of(self._first(*self._wanted))
        for number in range(first, first + 1 + _GROUPS_AHEAD):
            group = number % len(index) if self._loop else number
            if group >= len(index):
                return None
            if self._files.get(group) is None:  # counts as a use: what is needed soon is dropped last
                return group if self._error(index.starts[group]) is None else None
        return None

    def _fetch(self, number: int) -> None:
        index, began = self._reader.index, time.monotonic()
        first, stop = index.starts[number], (*index.starts, index.manifest.frame_count)[number + 1]
        try:
            group = self._reader.group(number)
            files = self._reader.fetch(group)
        except Exception as error:
            self._unavailable = self._unavailable + 1 if isinstance(error, SourceUnavailable) else 0
            self._fail(number, first, stop, error)
            return
        self._unavailable = 0
        now = time.monotonic()
        with self._changed:
            if number in self._failed and self._failed[number][1] is None:
                del self._failed[number]
            self._files.put(number, Fetched(group, files, now - began, now))

    def _missing(self) -> Iterator[int]:
        """The frames to decode, in order. Late ones are decoded on the way to the wanted one, but not once it is past
        them."""
        if self._wanted is None:
            return
        wanted, count = self._wanted[0], self._reader.frame_count
        for ahead in range(self._first(*self._wanted), wanted + AHEAD + 1):
            frame = ahead % count if self._loop else ahead
            if frame >= count:
                return
            late = ahead < min(wanted, self._decoded_until)
            if late or self._ready.get(frame) is not None:  # counts as a use: what is needed soon is dropped last
                continue
            if frame not in self._pending and self._error(frame) is None:
                yield frame

    def _frame_to_decode(self) -> tuple[int, Fetched] | None:
        for frame in self._missing():
            fetched = self._files.get(self._reader.index.group_of(frame))
            return None if fetched is None else (frame, fetched)
        return None

    def _decode(self, job: tuple[int, Fetched]) -> None:
        frame, fetched = job
        group, began = fetched.group, time.perf_counter()
        try:
            decoder = self._decoder
            if decoder is None or decoder.group is not group or decoder.next_frame > frame:
                self._close_decoder()
                decoder = self._decoder = self._reader.open_group(group, fetched.files)
            decoded = decoder.read()
            while decoder.next_frame <= frame:
                decoded = decoder.read()
        except Exception as error:
            first = group.first_frame if self._decoder is None else self._decoder.next_frame
            self._close_decoder()
            self._fail(group.index, first, group.end_frame, error)
            return
        with self._changed:
            self._decoded.append(_Decoded(frame, decoded, fetched, 1e3 * (time.perf_counter() - began)))
            self._pending.add(frame)
            self._decoded_until = frame + 1

    def _close_decoder(self) -> None:
        if self._decoder is not None:
            self._decoder.close()
            self._decoder = None

    def _frame_to_dequantize(self) -> _Decoded | None:
        """The oldest decoded frame, without those whose next one is already due."""
        due = -1 if self._wanted is None else self._wanted[0]
        wrapped = due + AHEAD - self._reader.frame_count if self._loop else -1  # up to this frame, it is the next lap
        while len(self._decoded) > 1 and wrapped < self._decoded[1].number <= due:
            self._pending.discard(self._decoded.popleft().number)
        return self._decoded.popleft() if self._decoded else None

    def _dequantize(self, decoded: _Decoded) -> None:
        frame, group, began = decoded.number, decoded.fetched.group, time.perf_counter()
        try:
            gaussians = self._finish(decoded.frame.gaussians())
        except Exception as error:
            self._fail(group.index, frame, frame + 1, error)
        else:
            milliseconds = 1e3 * (time.perf_counter() - began)
            fetch = 1e3 * decoded.fetched.seconds / group.frame_count
            size = group.bytes / group.frame_count
            stats = FrameStats(frame, group.index, size, fetch, decoded.milliseconds, milliseconds)
            self._ready.put(frame, PlayedFrame(frame, gaussians, stats, decoded.fetched))
        with self._changed:
            self._pending.discard(frame)

    def _error(self, frame: int) -> Exception | None:
        """Return why a frame cannot be played; None if that is not known, or is to be tried again."""
        group = self._reader.index.group_of(frame)
        skipped, error, when = self._failed.get(group, (None, None, 0.0))
        if skipped is None or not skipped.first_frame <= frame < skipped.stop:
            return None
        if error is not None and time.monotonic() - when > RETRY_SECONDS:
            self._failed[group] = (skipped, None, when)
            self._files.drop(group)
            return None
        return error

    def _fail(self, group: int, first: int, stop: int, error: Exception) -> None:
        """Record that the frames of a group from `first` to before `stop` cannot be played."""
        bug = None if isinstance(error, StudioError) else error
        if not isinstance(error, StudioError):
            error = StudioError("playback.failed", f"playback stopped ({type(error).__name__}: {error})")
            error.__cause__ = bug
        with self._changed:
            if self._closed:
                return  # the reader may have been closed; the group may be intact
            if group in self._failed:
                known = self._failed[group][0]
                first, stop = min(first, known.first_frame), max(stop, known.stop)
            skipped = SkippedGroup(group, first, stop - first, error.message)
            self._failed[group] = (skipped, error, time.monotonic())
            left_out = self.skipped
            if bug is not None or self._unavailable > 1:
                return  # twice in a row: the server is unreachable, not just a file
            if sum(left.frame_count for left in left_out) >= self._reader.frame_count and not self._reader.live:
                failure = nothing_playable("no frame of the stream can be played", left_out[0])
            else:
                failure = LeftOut("playback.group_skipped", str(skipped), group=group)
                failure.stop = stop
            self._failed[group] = (skipped, failure, time.monotonic())


def nothing_playable(problem: str, skipped: SkippedGroup) -> StudioError:
    """The error for a stream, or the rest of one, without any playable frame; its cause is that of `skipped`."""
    cause = skipped.cause
    problem, fields = f"{problem}; {cause.problem}", {"cause": cause.code, "group": skipped.group}
    return StudioError("playback.nothing_playable", problem, file=cause.file, fix=cause.fix, **fields)
