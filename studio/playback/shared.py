"""State shared by consecutive runs: the reader, the files of recent groups, the open decoder, and damaged groups."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict

from studio.errors import Message
from studio.playback.statistics import SkippedGroup
from studio.stream import GroupDecoder, GroupEntry, StreamReader, fetch_group

_CACHED_GROUPS = 6  # so that scrubbing does not fetch them again
_RETRY_AFTER = 10.0  # seconds after which a damaged group is tried again: it may have been repaired or uploaded


class Shared:
    """See the module docstring. Thread safe, except for `decoder`, which requires `decode_lock`."""

    def __init__(self, reader: StreamReader) -> None:
        self.reader = reader
        self.decode_lock = threading.Lock()  # one run decodes at a time; an ended run releases it within one frame
        self.decoder: GroupDecoder | None = None
        self._files: OrderedDict[int, dict[str, bytes]] = OrderedDict()
        self._skipped: dict[int, tuple[SkippedGroup, float]] = {}
        self._lock = threading.Lock()

    def files(self, group: GroupEntry) -> dict[str, bytes]:
        """The files of a group, from the cache, or fetched and verified."""
        with self._lock:
            if group.index in self._files:
                self._files.move_to_end(group.index)
                return self._files[group.index]
        files = fetch_group(self.reader.source, group)
        with self._lock:
            self._files[group.index] = files
            while len(self._files) > _CACHED_GROUPS:
                self._files.popitem(last=False)
        return files

    def close_decoder(self) -> None:
        """Release the decoder; the caller must hold `decode_lock`."""
        if self.decoder is not None:
            self.decoder.close()
            self.decoder = None

    def note_damage(self, group: GroupEntry, first_frame: int, end_frame: int, cause: Message) -> None:
        """Record that these frames of a group cannot be played."""
        with self._lock:
            if group.index in self._skipped:
                known = self._skipped[group.index][0]
                first_frame = min(first_frame, known.first_frame)
                end_frame = max(end_frame, known.first_frame + known.frame_count)
            skipped = SkippedGroup(group.index, first_frame, end_frame - first_frame, cause)
            self._skipped[group.index] = (skipped, time.monotonic())
            self._files.pop(group.index, None)

    def note_intact(self, group: GroupEntry) -> None:
        """Forget that a whole group could not be fetched, because it has been repaired."""
        with self._lock:
            known = self._skipped.get(group.index)
            if known is not None and known[0].frame_count == group.frame_count:
                del self._skipped[group.index]

    def is_lost(self, group: GroupEntry) -> bool:
        """Whether no frame of a group could be played when it was last tried, recently."""
        with self._lock:
            known = self._skipped.get(group.index)
            if known is None or known[0].frame_count < group.frame_count:
                return False
            return time.monotonic() - known[1] < _RETRY_AFTER

    @property
    def skipped(self) -> tuple[SkippedGroup, ...]:
        """All groups, or parts of groups, that could not be played, in order."""
        with self._lock:
            return tuple(self._skipped[index][0] for index in sorted(self._skipped))
