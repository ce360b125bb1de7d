"""The splats of a cast, frame by frame: its streams and static splats where the document puts them; and its sound."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from v3studio.pipelines.share.cast import Item, beside, read_cast
from v3studio.pipelines.share.cast_ground import Ground, Shadow
from v3studio.pipelines.takes.results.videos import FALLBACK_FPS, stream_place
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import read_splats
from v3studio.studio.formats.rigid_motion import placed
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.similarity import Similarity, rotation_between
from v3studio.studio.stream import StreamMetadata, StreamReader, StreamSound

LONGEST = 3600.0  # seconds after which a cast starts over at the latest

_UP = np.array([0.0, 1.0, 0.0])
_SIZE = (1280, 720)


@dataclass(frozen=True)
class _Stream:
    """`standing`: to coordinates in which it stands on y = 0; `place`: from there to the world; `start`: seconds."""

    reader: StreamReader
    standing: Similarity
    place: Similarity
    start: float


@dataclass(frozen=True)
class _Voice:
    """A stream's sound; `start` and `period` in samples."""

    sound: StreamSound
    start: int
    period: int


@dataclass
class CastSound:
    """The sound of a cast: that of its streams, each from its start on, over and over. A `Pcm` of two channels;
    all voices have its sample rate."""

    voices: Sequence[_Voice]
    sample_rate: int
    samples: int
    channels: int = 2

    def read(self, first: int, count: int) -> np.ndarray:
        """Samples, as in `Pcm`."""
        out = np.zeros((count, self.channels), np.float32)
        for voice in self.voices:
            done = max(voice.start - first, 0)
            while done < count:
                at = (first + done - voice.start) % voice.period
                length = min(count - done, voice.period - at)
                out[done : done + length] += voice.sound.read(at, length)  # of one channel, to both
                done += length
        return np.clip(out, -1, 1)

    def copy(self) -> CastSound:
        """Another one, to read at two places in turn without seeking."""
        return replace(self, voices=[replace(voice, sound=voice.sound.copy()) for voice in self.voices])

    def close(self) -> None:
        for voice in self.voices:
            voice.sound.close()


class CastFrames:
    """A cast as frames of splats, with its sound. Frames come at the highest rate of the streams, until the last has
    ended; streams that have ended before start over, and all splats have the dilation of the first stream, as on the
    page."""

    name = "decoded"
    first = 0

    def __init__(self, source: Path) -> None:
        cast = read_cast(source)
        view = cast.camera
        self.camera = Camera.look_at(
            view.position, view.target, _UP, width=_SIZE[0], height=_SIZE[1], field_of_view=view.fov
        )
        self.background = cast.background
        self.group_starts: Sequence[int] = (0,)
        self._still: list[Gaussians] = []
        self._streams: list[_Stream] = []
        self._plane = cast.ground
        self._held: tuple[int, Gaussians, list[Shadow]] | None = None
        with ExitStack() as stack:
            for item in cast.items:
                self._add(item, source, stack)
            self._open = stack.pop_all()
        self.fps = max((float(stream.reader.fps) for stream in self._streams), default=FALLBACK_FPS)
        ends = [stream.start + stream.reader.frame_count / stream.reader.fps for stream in self._streams]
        self.frame_count = max(1, round(min(max(ends, default=0.0), LONGEST) * self.fps))

    has_set = False

    def behind(self) -> None:
        """Performers of a cast have no set of their own: its surroundings are another file."""

    def gaussians(self, frame: int) -> Gaussians:
        """The splats of all in a frame. Raises StudioError if a stream is damaged."""
        return self._read(frame)[1]

    def ground(self, frame: int) -> Ground | None:
        """The ground in a frame; None if there is none. Raises as `gaussians`."""
        return Ground(self._plane, self._read(frame)[2]) if self._plane is not None else None

    def _read(self, frame: int) -> tuple[int, Gaussians, list[Shadow]]:
        """The frame, its splats, and the shadows. The last one is kept: the view may change."""
        if self._held is not None and self._held[0] == frame:
            return self._held
        parts, shadows = [], []
        for stream in self._streams:
            seconds = max(frame / self.fps - stream.start, 0.0)
            own = stream.reader.gaussians(int(seconds * stream.reader.fps + 1e-6) % stream.reader.frame_count)
            parts.append(placed(own, stream.place.after(stream.standing)))
            if self._plane is not None and self._plane.shadow > 0:
                shadows.append(Shadow.of(parts[-1], _bounds(stream), stream.place, self._plane.shadow))
        parts += self._still
        degree = max(part.sh_degree for part in parts)
        dilation = parts[0].dilation
        whole = Gaussians.cat(*(replace(part.with_sh_degree(degree), dilation=dilation) for part in parts))
        self._held = frame, whole, shadows
        return self._held

    @property
    def has_sound(self) -> bool:
        return any(stream.reader.manifest.audio is not None for stream in self._streams)

    def sound(self) -> CastSound | None:
        """The sound of all; the caller closes it. None if there is none. Raises StudioError: `share.sample_rates`."""
        with ExitStack() as stack:
            voices: list[_Voice] = []
            for stream in self._streams:
                sound = stream.reader.sound()
                if sound is not None:
                    stack.callback(sound.close)
                    period = stream.reader.frame_count / stream.reader.fps
                    voices.append(_Voice(sound, *(round(time * sound.sample_rate) for time in (stream.start, period))))
            if not voices:
                return None
            rates = sorted({voice.sound.sample_rate for voice in voices})
            if len(rates) > 1:
                problem = f"the sounds of its streams have different sample rates, {rates[0]} and {rates[-1]}"
                raise StudioError("share.sample_rates", problem, value=rates, fix="Bake the streams again.")
            stack.pop_all()
        return CastSound(voices, rates[0], round(self.frame_count / self.fps * rates[0]))

    def close(self) -> None:
        self._open.close()

    def _add(self, item: Item, source: Path, stack: ExitStack) -> None:
        place = placement(item)
        if item.stream is not None:
            reader = stack.enter_context(StreamReader.open(stream_place(beside(item.stream, source))))
            self._streams.append(_Stream(reader, standing(reader), place, item.start))
        elif item.splats is not None:
            self._still.append(placed(read_splats(beside(item.splats, source)), place))


def placement(item: Item) -> Similarity:
    """The transform from the coordinates in which an item stands on y = 0, or from those of its file, to the world."""
    turn = Rotation.from_euler("XYZ", item.turn, degrees=True).as_matrix()
    return Similarity(item.scale, turn, np.array(item.position))


def standing(reader: StreamReader) -> Similarity:
    """The transform from the world of a stream to one with y up, whose ground is below its lowest point."""
    up = StreamMetadata.from_json(reader.manifest.metadata).up
    turn = np.eye(3) if up is None else rotation_between(np.array(up), _UP)  # as three.js's setFromUnitVectors
    box = reader.manifest.bounding_box
    lowest = np.minimum(turn[1] * box.min, turn[1] * box.max).sum()
    return Similarity(1.0, turn, -lowest * _UP)


def _bounds(stream: _Stream) -> np.ndarray:
    """(2, 3) the whole take's bounds, where it stands."""
    box = stream.reader.manifest.bounding_box
    corners = np.array(np.meshgrid(*zip(box.min, box.max, strict=True))).reshape(3, -1).T
    placed_corners = stream.standing.points(corners)
    return np.array([placed_corners.min(axis=0), placed_corners.max(axis=0)])
