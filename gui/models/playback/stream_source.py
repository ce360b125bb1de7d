"""StreamSource: the frames of a baked stream for the window, decoded a little ahead.

It keeps fetched files and notes damaged groups as `studio.playback` does. The window's transport, which also runs over
footage and trained frames, is the clock.
"""

import threading
import time
from collections.abc import Sequence
from pathlib import Path

from pipelines.takes.videos import capture_place
from studio.coverage import ViewRange
from studio.errors import Message, StudioError
from studio.formats.rigid_motion import placed
from studio.gaussians import Gaussians
from studio.memory_cache import MemoryCache
from studio.playback import Shared, SkippedGroup
from studio.playback.pipeline import nothing_playable
from studio.similarity import Similarity
from studio.stream import GroupDecoder, SourceUnavailable, StreamMetadata, StreamReader, StreamSound

CACHE_BYTES = 512 * 1024 * 1024
AHEAD = 4  # number of frames decoded ahead of the one on screen
RETRY_SECONDS = 10.0  # seconds before a damaged frame is tried again: it may have been fixed or uploaded


class LeftOut(StudioError):
    """A frame that playback passes over: its group is damaged or missing (`playback.group_skipped`), or the take is
    trimmed (`playback.trimmed`). Others can be played."""


def frame_cache() -> MemoryCache[int, Gaussians]:
    """The most recently used frames, up to `CACHE_BYTES`, but always a few."""
    return MemoryCache(CACHE_BYTES, lambda frame: sum(one.nbytes for _, one in frame.items()), least=AHEAD + 2)


class StreamSource:
    """See the module. One thread decodes the requested frame and then a few after it, so that the next frames are
    decoded while one is drawn. StudioError if it is not a stream, or the manifest is damaged.

    `in_take`: whether frames are counted, and splats placed, as in the take that the stream was baked from, whose edits
    may have trimmed and moved it: then `first` may be above 0, and `frame_count` has the frames before it, too.
    """

    name = "decoded"
    fades = False  # whether views from where nothing was filmed are faded, as in other players

    def __init__(self, place: Path | str, in_take: bool = False) -> None:
        self._reader = StreamReader.open(place)
        self._shared, self._metadata = Shared(self._reader), StreamMetadata.from_json(self._reader.manifest.metadata)
        self.fps, self.groups = float(self._reader.fps), self._reader.groups
        self.has_sound = self._reader.manifest.audio is not None
        self.suggested_camera = self._metadata.suggested_camera  # the first view; None if there is none
        self._count = self._reader.frame_count
        self.first, self._back = 0, Similarity()
        if in_take:
            found = capture_place(self._reader)
            self.first, self._back = found.first_frame, found.world.inverse
        self.frame_count = self.first + self._count
        self.group_starts: Sequence[int] = [self.first + start for start in self._reader.index.starts]
        self._cache = frame_cache()
        self._decoder: GroupDecoder | None = None
        self._changed = threading.Condition()
        self._wanted: int | None = None
        self._failed: dict[int, tuple[Exception, float]] = {}
        self._unavailable = 0  # consecutive groups that the server did not deliver
        self._was_decoded: set[int] = set()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="v3studio decode ahead", daemon=True)
        self._thread.start()

    def gaussians(self, frame: int) -> Gaussians:
        """See `FrameSource`. Raises LeftOut: the frame's group is damaged; other groups can be played."""
        if frame < self.first:
            raise LeftOut("playback.trimmed", "trimmed off: the stream does not have it", frame=frame)
        frame -= self.first
        with self._changed:
            self._wanted = frame
            self._changed.notify_all()
            while True:
                held = self._cache.get(frame)
                if held is not None:
                    return held
                error = self._error(frame)
                if error is not None:
                    raise error
                if self._closed:
                    raise StudioError("playback.closed", "the stream has been closed", file=self._reader.source.name)
                self._changed.wait()

    @property
    def skipped(self) -> tuple[SkippedGroup, ...]:
        """Damaged groups found so far."""
        return self._shared.skipped

    def _error(self, frame: int) -> Exception | None:
        found = self._failed.get(frame)
        if found is None:
            return None
        if time.monotonic() - found[1] > RETRY_SECONDS:
            del self._failed[frame]
            return None
        return found[0]

    def _next_missing(self) -> int | None:
        """The frame to decode next: the wanted one, or the first missing one after it (playback loops)."""
        if self._wanted is None:
            return None
        for ahead in range(AHEAD + 1):
            frame = (self._wanted + ahead) % self._count
            if frame not in self._cache and self._error(frame) is None:
                return frame
        return None

    def _work(self) -> None:
        while True:
            with self._changed:
                while not self._closed and (frame := self._next_missing()) is None:
                    self._changed.wait()
                if self._closed:
                    return
                assert frame is not None
            try:
                decoded = placed(self._decoded(frame), self._back)
            except Exception as error:  # raised when the frame is requested
                with self._changed:
                    self._note(frame, error)
                    self._changed.notify_all()
            else:
                with self._changed:
                    self._was_decoded.add(frame)
                    self._cache.put(frame, decoded)
                    self._changed.notify_all()

    def _decoded(self, frame: int) -> Gaussians:
        shared, group = self._shared, self._reader.group_of(frame)
        files = shared.files(group)
        self._unavailable = 0
        shared.note_intact(group)
        decoder = self._decoder
        if decoder is None or decoder.group is not group or decoder.next_frame > frame:
            self._close_decoder()
            decoder = self._decoder = self._reader.open_group(group, files)
        try:
            while True:
                decoded = decoder.read()
                if decoder.next_frame > frame:
                    return decoded.gaussians()
        except BaseException:
            self._close_decoder()
            raise

    def _close_decoder(self) -> None:
        if self._decoder is not None:
            self._decoder.close()
            self._decoder = None

    def _note(self, frame: int, error: Exception) -> None:
        """Record the frames from this one to the end of its group as unplayable."""
        group = self._reader.group_of(frame)
        self._unavailable = self._unavailable + 1 if isinstance(error, SourceUnavailable) else 0
        first = frame  # earlier frames are unplayable too, unless they were decoded
        while first > group.first_frame and first - 1 not in self._was_decoded:
            first -= 1
        bug = Message("playback.failed", str(error) or type(error).__name__)
        why = error.message if isinstance(error, StudioError) else bug
        self._shared.note_damage(group, first, group.end_frame, why)
        lost = sum(one.frame_count for one in self._shared.skipped)
        failure: Exception
        if self._unavailable > 1:
            failure = error  # twice in a row: the problem is the server, not the group
        elif lost >= self._count:
            failure = nothing_playable("no frame of the stream can be played", self._shared.skipped[0])
        else:
            skipped = next(one for one in self._shared.skipped if one.group == group.index)
            failure = LeftOut("playback.group_skipped", str(skipped), group=group.index)
        for lost_frame in range(first, group.end_frame):
            self._failed[lost_frame] = (failure, time.monotonic())

    def sound(self) -> StreamSound | None:
        """The stream's sound from frame `first` on, fetched now, which the caller closes; None: silent. StudioError."""
        return self._reader.sound()

    @property
    def view_range(self) -> ViewRange | None:
        """From where the stream can be looked at, if views from elsewhere are to be faded."""
        return self._metadata.view_range if self.fades else None

    def close(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._reader.end_reads()
        self._thread.join()
        self._close_decoder()
        self._cache.clear()
        self._reader.close()
