"""The threads of a player: fetch -> decode -> dequantise, with bounded lanes between them.

A `Run` delivers frames in order from one start frame. Seeking ends the run and begins another; what both can use
(files that were fetched, the open decoder) lies in `Shared`. Frames are numbered by *ticks*, which go on rising when
the stream loops: frame = tick % frame_count.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.playback.lane import Lane
from studio.playback.statistics import FrameStats
from studio.stream import GroupDecoder, GroupEntry, StreamReader, dequantise_planes, fetch_group

FETCHED_GROUPS = 1  # waiting; with one being decoded and one being fetched, up to three are in memory
DECODED_FRAMES = 3
READY_FRAMES = 4
_KEPT_GROUPS = 6  # so that scrubbing to and fro fetches nothing again


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
    planes: np.ndarray
    fetch_ms: float
    decode_ms: float


class Shared:
    """What outlives a run: the reader, the last few groups' files, and the decoder that is open."""

    def __init__(self, reader: StreamReader) -> None:
        self.reader = reader
        self.decode_lock = threading.Lock()  # one run decodes at a time; a run that was ended leaves within a frame
        self.decoder: GroupDecoder | None = None
        self._files: OrderedDict[int, dict[str, bytes]] = OrderedDict()
        self._files_lock = threading.Lock()

    def files(self, group: GroupEntry) -> dict[str, bytes]:
        """The group's files, kept from before or fetched and checked now."""
        with self._files_lock:
            if group.index in self._files:
                self._files.move_to_end(group.index)
                return self._files[group.index]
        files = fetch_group(self.reader.source, group)
        with self._files_lock:
            self._files[group.index] = files
            while len(self._files) > _KEPT_GROUPS:
                self._files.popitem(last=False)
        return files

    def close_decoder(self) -> None:
        """Free the decoder; only with `decode_lock` held."""
        if self.decoder is not None:
            self.decoder.close()
            self.decoder = None


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
        self._fetched: Lane[_Fetched] = Lane(FETCHED_GROUPS)
        self._decoded: Lane[_Decoded] = Lane(DECODED_FRAMES)
        self.ready: Lane[PlayedFrame] = Lane(READY_FRAMES)
        self.error: BaseException | None = None
        self._dropped = 0
        self._dropped_lock = threading.Lock()
        stages = (
            ("fetch", self._fetch, self._fetched),
            ("decode", self._decode, self._decoded),
            ("dequantise", self._dequantise, self.ready),
        )
        self._threads = [
            threading.Thread(target=self._guarded, args=(work, lane), name=f"playback-{name}", daemon=True)
            for name, work, lane in stages
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
        for lane in (self._fetched, self._decoded, self.ready):
            lane.abort()

    def join(self) -> None:
        """Wait until the threads have ended (after `stop`)."""
        for thread in self._threads:
            thread.join()

    def _guarded(self, work: Callable[[], None], lane: Lane) -> None:
        """Run one stage; whatever it raises ends the run, after the frames that were made before it."""
        try:
            work()
        except BaseException as error:
            if self.error is None:
                self.error = error
        finally:
            lane.finish()

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
        for start_tick, group in self._groups():
            end_tick = start_tick + group.frame_count
            if self._late(end_tick):
                self.count_dropped(end_tick - max(start_tick, self._start))
                continue
            began = time.perf_counter()
            files = self._shared.files(group)
            milliseconds = 1e3 * (time.perf_counter() - began)
            if self._fetched.put(_Fetched(start_tick, group, files, milliseconds)) is None:
                return

    def _decode(self) -> None:
        with self._shared.decode_lock:
            while (fetched := self._fetched.get()) is not None:
                if not self._decode_group(fetched):
                    return

    def _decode_group(self, fetched: _Fetched) -> bool:
        """Decode one group from where it is wanted; False when the run is over."""
        shared, group = self._shared, fetched.group
        end_tick = fetched.start_tick + group.frame_count
        first = max(fetched.start_tick, self._start)
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
                planes = decoder.read()
                if tick < first:
                    if self._decoded.over:  # seeking: a newer run may be waiting for its turn
                        return False
                    continue
                now = time.perf_counter()
                share = fetched.milliseconds / group.frame_count
                if self._decoded.put(_Decoded(tick, group, planes, share, 1e3 * (now - began))) is None:
                    return False
                began = time.perf_counter()
        except BaseException:
            shared.close_decoder()
            raise
        return True

    def _dequantise(self) -> None:
        count = self._manifest.frame_count
        while (decoded := self._decoded.get()) is not None:
            following = self._decoded.peek()
            if following is not None and self._late(following.tick):
                self.count_dropped(1)
                continue
            group = decoded.group
            began = time.perf_counter()
            gaussians = dequantise_planes(group, decoded.planes)
            milliseconds = 1e3 * (time.perf_counter() - began)
            frame = decoded.tick % count
            stats = FrameStats(
                frame, group.index, group.bytes / group.frame_count, decoded.fetch_ms, decoded.decode_ms, milliseconds
            )
            item = PlayedFrame(self.number, decoded.tick, frame, gaussians, stats)
            dropped = self.ready.put(item, (lambda second: self._late(second.tick)) if self._due else None)
            if dropped is None:
                return
            self.count_dropped(dropped)


def raise_for_user(error: BaseException) -> None:
    """Raise what ended a run: a StudioError as it is, all else wrapped in one that says where it came from."""
    if isinstance(error, StudioError):
        raise error
    raise StudioError(f"Playing stopped: {type(error).__name__}: {error}.") from error
