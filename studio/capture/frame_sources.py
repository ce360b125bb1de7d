"""The frames of one camera, from images or a video."""

import threading
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from itertools import accumulate
from pathlib import Path
from typing import Protocol

import numpy as np

from v3studio.studio.capture.images import image_header, read_image
from v3studio.studio.capture.patterns import VIDEO_EXTENSIONS, Match, interval_of
from v3studio.studio.capture.transfer import TransferFunction
from v3studio.studio.capture.video import VideoReader
from v3studio.studio.chroma import ChromaSampling
from v3studio.studio.errors import StudioError
from v3studio.studio.memory import memory_available


class FrameSource(Protocol):
    """Frames of one camera, as stored. With a sync offset, its frame f is frame f + offset of the files."""

    camera: str
    frames: tuple[int, ...]  # sorted frame numbers
    width: int  # width, height: size of every frame in pixels
    height: int
    has_alpha: bool  # whether frames have an alpha channel
    fps: float | None  # frames per second; None if the files do not specify it
    note: str  # what is unusual about the files, as a clause; "" if nothing

    def read(self, frame: int) -> np.ndarray:
        """(H, W, 3) RGB or (H, W, 4) RGBA uint8; StudioError if there is no such frame, or its file cannot be read."""

    def files(self, frames: Iterable[int] | None = None) -> list[Path]:
        """The files that contain the given frames (None: all)."""

    @property
    def chroma(self) -> ChromaSampling | None:
        """Chroma grid of the frames; None: no subsampling, or not known (images)."""
        return None


class ImageSource(FrameSource):
    """A `FrameSource` with one image file per frame number; `transfer`: what values are, see `read_image`."""

    def __init__(
        self, camera: str, paths: Mapping[int, Path], transfer: TransferFunction, offset: int, fps: float | None = None
    ) -> None:
        self.camera = camera
        self._transfer, self._offset = transfer, offset
        self._paths = dict(sorted(paths.items()))
        self.frames = tuple(number - offset for number in self._paths)
        self.width, self.height, self.has_alpha, self.note = image_header(next(iter(self._paths.values())))
        self.fps = fps

    def read(self, frame: int) -> np.ndarray:
        """The image as `FrameSource.read` describes it. StudioError: its size or alpha channel differs from the
        camera's first image, there is no such frame, or the file cannot be read."""
        frame += self._offset
        path = self._paths.get(frame)
        if path is None:
            problem = f"Camera '{self.camera}' has no image for frame {frame}"
            raise StudioError("footage.no_such_frame", problem, value=frame, camera=self.camera, frame=frame)
        image = read_image(path, self._transfer)
        if image.shape[:2] != (self.height, self.width):
            raise StudioError(
                "footage.size_changed",
                f"the image is {image.shape[1]}x{image.shape[0]}, but the first image of camera '{self.camera}' is "
                f"{self.width}x{self.height}",
                file=path,
                value=(image.shape[1], image.shape[0]),
                fix="All frames of a camera must have the same size.",
                camera=self.camera,
                frame=frame,
                expected=(self.width, self.height),
            )
        if image.shape[2] == 3 and self.has_alpha:
            problem = f"the image has no alpha channel, but the first image of camera '{self.camera}' has one"
            fix = "Replace the file or exclude the frame."
            raise StudioError("footage.alpha_missing", problem, file=path, fix=fix, camera=self.camera, frame=frame)
        return image if self.has_alpha else np.ascontiguousarray(image[:, :, :3])

    def files(self, frames: Iterable[int] | None = None) -> list[Path]:
        numbers = [frame + self._offset for frame in (self.frames if frames is None else frames)]
        return [self._paths[number] for number in numbers if number in self._paths]


class DecoderPool:
    """Keeps at most `limit` video decoders open and closes the least recently used. Thread safe."""

    def __init__(self, limit: int) -> None:
        self.limit = max(1, limit)
        self._open: OrderedDict[int, VideoReader] = OrderedDict()
        self._lock = threading.Lock()

    def touch(self, reader: VideoReader) -> None:
        """Mark `reader` as most recently used, and close decoders above the limit."""
        surplus: list[VideoReader] = []
        with self._lock:
            self._open[id(reader)] = reader
            self._open.move_to_end(id(reader))
            while len(self._open) > self.limit:
                surplus.append(self._open.popitem(last=False)[1])
        for other in surplus:
            other.close()

    def close(self) -> None:
        with self._lock:
            readers = list(self._open.values())
            self._open.clear()
        for reader in readers:
            reader.close()


class VideoSource(FrameSource):
    """A `FrameSource` of one video, or of several, in order, into which a camera has split one recording. Frames are
    numbered from 0. Raises StudioError, see `VideoReader`."""

    def __init__(
        self, camera: str, paths: list[Path], pool: DecoderPool, matrix: str, transfer: TransferFunction, offset: int
    ) -> None:
        self.camera = camera
        self._pool, self._offset = pool, offset
        self._readers: list[VideoReader] = []
        for path in paths:
            self._readers.append(VideoReader(path, matrix, transfer))
            pool.touch(self._readers[-1])
        first = self._readers[0]
        self.width, self.height = first.width, first.height
        self.has_alpha, self.fps = first.has_alpha, first.fps
        for part in self._readers:
            differs = part.fps and self.fps and abs(part.fps / self.fps - 1) > 0.005
            if differs or (part.width, part.height, part.has_alpha) != (self.width, self.height, self.has_alpha):
                problem = (
                    f"the video differs in size, frame rate or alpha from {first.path.name}, of which it is taken to "
                    "be a later part"
                )
                fix = "Keep the files of one recording only, or narrow the pattern in capture.images."
                raise StudioError(
                    "footage.chapters_differ", problem, file=part.path, fix=fix, camera=camera, setting="capture.images"
                )
        *self._starts, count = accumulate((part.frame_count for part in self._readers), initial=0)
        self.frames = tuple(range(-offset, count - offset))
        notes = dict.fromkeys(part.note for part in self._readers if part.note)
        if len(paths) > 1:
            notes[f"{len(paths)} files are read as one recording, in the order of their names"] = None
        self.note = "; ".join(notes)

    def take_matrix_of(self, others: Iterable["VideoSource"]) -> None:
        """Read a video that does not tell its YUV to RGB matrix with that of the other cameras, if they have one."""
        tags = {reader.tag for other in others for reader in other._readers}
        untagged = [reader for reader in self._readers if reader.tag == ""]
        if untagged and len(tags - {"", None}) == 1:
            tag = next(tag for tag in tags if tag)
            for reader in untagged:
                reader.use_matrix(tag)
            words = (
                f"the video has no color matrix; that of the other cameras is used, {tag.upper().replace('BT', 'BT.')}"
            )
            self.note = "; ".join(filter(None, (self.note, words)))

    def _part(self, frame: int) -> int:
        return max(0, bisect_right(self._starts, frame + self._offset) - 1)

    def read(self, frame: int) -> np.ndarray:
        index = self._part(frame)
        self._pool.touch(self._readers[index])
        return self._readers[index].read(frame + self._offset - self._starts[index])

    def files(self, frames: Iterable[int] | None = None) -> list[Path]:
        used = range(len(self._readers)) if frames is None else sorted({self._part(frame) for frame in frames})
        return [self._readers[index].path for index in used]

    @property
    def chroma(self) -> ChromaSampling | None:
        return self._readers[0].chroma


def decoder_limit(width: int, height: int) -> int:
    """Number of decoders for videos of this size (in pixels) that fit into a quarter of the free memory; at least 4."""
    # A decoder holds up to 16 reference frames and a few more, at 1.5 bytes per pixel.
    each = width * height * 1.5 * 18 + (1 << 20)
    return max(4, int(memory_available() / 4 / each))


def make_sources(
    matches: list[Match], pool: DecoderPool, offsets: Mapping[str, int], transfer: TransferFunction, matrix: str
) -> dict[str, FrameSource]:
    """Camera name to its source, from the files that match a pattern. Images without `{frame}` become frame 0."""
    groups: dict[str, list[Match]] = {}
    for match in matches:
        groups.setdefault(match.camera, []).append(match)
    sources: dict[str, FrameSource] = {}
    for camera, group in groups.items():
        videos = [match for match in group if match.path.suffix.lower() in VIDEO_EXTENSIONS]
        chapters = len(videos) == len(group) and all(match.chapter for match in group)
        if videos and ((len(group) > 1 and not chapters) or videos[0].frame is not None):
            problem = f"the file is a video, but the pattern treats it as a single frame of camera '{camera}'"
            fix = (
                "Remove {frame} from the pattern."
                if len(group) == 1
                else "Put {chapter} in the place of {frame} if the videos are parts of one recording, else name one."
            )
            raise StudioError("footage.video_as_frame", problem, file=videos[0].path, fix=fix, camera=camera)
        offset = offsets.get(camera, 0)
        if videos:
            paths = [match.path for match in videos]
            sources[camera] = VideoSource(camera, paths, pool, matrix, transfer, offset)
        else:
            interval = interval_of([match.seconds for match in group if match.seconds is not None])
            files = {match.frame or 0: match.path for match in group}
            sources[camera] = ImageSource(camera, files, transfer, offset, 1 / interval if interval else None)
    videos_of = [source for source in sources.values() if isinstance(source, VideoSource)]
    for source in videos_of if matrix == "auto" else ():
        source.take_matrix_of(videos_of)
    kinds = {not isinstance(source, ImageSource): camera for camera, source in sources.items()}
    if len(kinds) > 1:
        problem = f"Camera '{kinds[True]}' is a video and camera '{kinds[False]}' is an image sequence"
        fix = "A capture must be either videos or images; narrow the pattern in capture.images."
        raise StudioError(
            "footage.mixed_media", problem, fix=fix, cameras=[kinds[True], kinds[False]], setting="capture.images"
        )
    return sources
