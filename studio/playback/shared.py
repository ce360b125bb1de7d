"""What is known of a stream while it is played: files of recent groups, and damaged groups."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from studio.errors import Message, StudioError
from studio.memory_cache import MemoryCache
from studio.playback.rate_rule import RateRule
from studio.playback.statistics import SkippedGroup
from studio.stream import Rendition, StreamReader

_CACHED_GROUPS = 6  # so that scrubbing does not fetch them again
_LOOK_AGAIN = 0.2  # seconds between two looks at whether a run is over that waits for new groups


@dataclass(frozen=True)
class Span:
    """A group's place in the stream, known without its page of the index."""

    index: int
    first_frame: int
    frame_count: int

    @property
    def end_frame(self) -> int:
        """Index of the first frame after the group."""
        return self.first_frame + self.frame_count


class Shared:
    """See the module docstring. Thread safe. `rule` changes renditions, if the stream comes from a web server and has
    several; None: the reader's is kept."""

    def __init__(self, reader: StreamReader) -> None:
        self.reader = reader
        self.rule: RateRule | None = None
        if reader.source.parallel > 1 and len(reader.manifest.renditions) > 1:
            self.rule = RateRule([one.bandwidth for one in reader.manifest.renditions])
        self._renditions = {one.id: number for number, one in enumerate(reader.manifest.renditions)}
        self._files: MemoryCache[tuple[int, str], dict[str, bytes]] = MemoryCache(_CACHED_GROUPS)
        self._skipped: dict[int, SkippedGroup] = {}
        self._lock = threading.Lock()
        self._grown = threading.Condition()
        self.replaced: StudioError | None = None

    def lost(self, error: StudioError) -> None:
        """The live stream was replaced by another one."""
        self.replaced = error
        self.grown()

    def grown(self) -> None:
        """The reader has found more groups of a live stream, or the stream is complete."""
        with self._grown:
            self._grown.notify_all()

    def wait_for_more(self, groups: int, over: Callable[[], bool]) -> bool:
        """Wait until a live stream has more than so many groups; False if it is complete or was replaced by another
        one, or if `over` returns True."""
        with self._grown:
            while not over():
                if len(self.reader.index) > groups:
                    return True
                if not self.reader.live or self.replaced is not None:
                    return False
                self._grown.wait(_LOOK_AGAIN)
        return False

    def choose(self, number: int, buffered: float) -> Rendition:
        """Group `number` in the rendition to play it in, with `buffered` seconds of frames that are fetched and not yet
        shown. StudioError if its page of the index is missing or damaged."""
        if self.rule is None:
            return self.reader.group(number)
        return self.reader.index.group(number).renditions[self.rule.choose(buffered)]

    def played(self, group: Rendition, shown: int = 0, dropped: int = 0) -> None:
        """Tell the rule about frames that were shown, or were dropped since decoding was late."""
        if self.rule is not None:
            self.rule.played(self._renditions[group.id], shown, dropped)

    def files(self, group: Rendition) -> dict[str, bytes]:
        """The files of a group, from the cache, or fetched and verified."""

        def fetch(_: tuple[int, str]) -> dict[str, bytes]:
            began = time.perf_counter()
            files = self.reader.fetch(group)
            if self.rule is not None:
                self.rule.fetched(group.bytes, time.perf_counter() - began)
            return files

        return self._files.get_or_make((group.index, group.id), fetch)

    def note_damage(self, group: Rendition | Span, first_frame: int, end_frame: int, cause: Message) -> None:
        """Record that these frames of a group cannot be played."""
        with self._lock:
            known = self._skipped.get(group.index)
            if known is not None:
                first_frame = min(first_frame, known.first_frame)
                end_frame = max(end_frame, known.stop)
            self._skipped[group.index] = SkippedGroup(group.index, first_frame, end_frame - first_frame, cause)
            for key in [key for key in self._files if key[0] == group.index]:
                self._files.drop(key)

    def note_intact(self, group: Rendition) -> None:
        """Forget that a whole group could not be fetched, because it has been repaired."""
        with self._lock:
            known = self._skipped.get(group.index)
            if known is not None and known.frame_count == group.frame_count:
                del self._skipped[group.index]

    @property
    def skipped(self) -> tuple[SkippedGroup, ...]:
        """All groups, or parts of groups, that could not be played, in order."""
        with self._lock:
            return tuple(self._skipped[index] for index in sorted(self._skipped))
