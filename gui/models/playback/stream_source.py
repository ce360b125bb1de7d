"""StreamSource: the frames of a baked stream for the window.

The window's transport, which also runs over footage and trained frames, is the clock.
"""

from collections.abc import Sequence
from pathlib import Path

from v3studio.gui.drawing.compare import What
from v3studio.pipelines.takes.results.videos import capture_place
from v3studio.studio.calibration.coverage import ViewRange
from v3studio.studio.formats.rigid_motion import placed
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.memory_cache import MemoryCache
from v3studio.studio.playback import LeftOut, SkippedGroup, StreamFrames
from v3studio.studio.similarity import Similarity
from v3studio.studio.stream import StreamMetadata, StreamReader, StreamSound

CACHE_BYTES = 512 * 1024 * 1024  # of frames that are kept


class StreamSource:
    """The frames of a baked stream. StudioError if it is not a stream, or the manifest is damaged.

    `in_take`: whether frames are counted, and splats placed, as in the take that the stream was baked from, whose edits
    may have trimmed and moved it: then `first` may be above 0, and `frame_count` has the frames before it, too.
    """

    name: str = What.DECODED
    fades = False  # whether views from where nothing was filmed are faded, as in other players

    def __init__(self, place: Path | str, in_take: bool = False) -> None:
        self._reader = StreamReader.open(place)
        self._metadata = StreamMetadata.from_json(self._reader.manifest.metadata)
        self.fps, self.groups = float(self._reader.fps), self._reader.groups
        self.has_sound = self._reader.manifest.audio is not None
        self.suggested_camera = self._metadata.suggested_camera  # the first view; None if there is none
        self.first, back = 0, Similarity()
        if in_take:
            place_in_take = capture_place(self._reader)
            self.first, back = place_in_take.first_frame, place_in_take.world.inverse
        self.frame_count = self.first + self._reader.frame_count
        self.group_starts: Sequence[int] = [self.first + start for start in self._reader.index.starts]
        self._back = back
        self._set: MemoryCache[int, Gaussians | None] = MemoryCache(1)
        self._frames = StreamFrames(self._reader, CACHE_BYTES, loop=True, finish=lambda splats: placed(splats, back))

    @property
    def has_set(self) -> bool:
        """Tell whether there are splats behind the performer."""
        return bool(self._reader.manifest.set)

    def behind(self) -> Gaussians | None:
        """The splats behind the performer; None if there are none. StudioError if their files are damaged."""
        return self._set.get_or_make(0, self._read_set)

    def _read_set(self, _: int) -> Gaussians | None:
        splats = self._reader.set_splats()
        return None if splats is None else placed(splats, self._back)

    def gaussians(self, frame: int) -> Gaussians:
        """The splats of a frame. Raises LeftOut: the frame's group is damaged; other groups can be played."""
        if frame < self.first:
            raise LeftOut("playback.trimmed", "trimmed off: the stream does not have it", frame=frame)
        return self._frames.get(frame - self.first).gaussians

    @property
    def skipped(self) -> tuple[SkippedGroup, ...]:
        """Damaged groups found so far."""
        return self._frames.skipped

    def sound(self) -> StreamSound | None:
        """The stream's sound from frame `first` on, fetched now, which the caller closes; None: silent. StudioError."""
        return self._reader.sound()

    @property
    def view_range(self) -> ViewRange | None:
        """The views from which the stream was filmed, if others are to be faded."""
        return self._metadata.view_range if self.fades else None

    def close(self) -> None:
        self._reader.end_reads()
        self._frames.close()
        self._reader.close()
