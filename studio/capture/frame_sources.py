"""One camera's frames, whatever files they lie in."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Protocol

import numpy as np

from studio.capture.images import has_alpha, image_size, read_image
from studio.capture.patterns import VIDEO_EXTENSIONS, Match
from studio.capture.video import VideoReader
from studio.errors import StudioError


class FrameSource(Protocol):
    """Frames of one camera as they lie in the files.

    Attributes:
        camera: its name.
        frames: sorted frame numbers, as in the files.
        width, height: pixels of every frame.
        has_alpha: images come with an alpha channel.
        fps: frames a second where the files say it.
    """

    camera: str
    frames: tuple[int, ...]
    width: int
    height: int
    has_alpha: bool
    fps: float | None

    def read(self, frame: int) -> np.ndarray:
        """(H, W, 3) RGB or (H, W, 4) RGBA uint8. Raises StudioError where it cannot."""
        ...

    def files(self, frames: Iterable[int] | None = None) -> list[Path]:
        """The files behind the given frames (None: all)."""
        ...

    def where(self, frame: int) -> str:
        """What to call this frame in a message."""
        ...


class ImageSource:
    """A `FrameSource` of one image file a frame."""

    def __init__(self, camera: str, paths: Mapping[int, Path]) -> None:
        self.camera = camera
        self._paths = dict(sorted(paths.items()))
        self.frames = tuple(self._paths)
        first = self._paths[self.frames[0]]
        self.width, self.height = image_size(first)
        self.has_alpha = has_alpha(first)
        self.fps: float | None = None

    def read(self, frame: int) -> np.ndarray:
        """See `FrameSource`; an image whose size differs from the camera's first is refused."""
        path = self._paths.get(frame)
        if path is None:
            raise StudioError(f"Camera '{self.camera}' has no image for frame {frame}.")
        image = read_image(path)
        if image.shape[:2] != (self.height, self.width):
            raise StudioError(
                f"The image {path} is {image.shape[1]}x{image.shape[0]}, but camera '{self.camera}' began with "
                f"{self.width}x{self.height}; all frames of a camera must have one size."
            )
        if image.shape[2] == 3 and self.has_alpha:
            raise StudioError(f"The image {path} has no alpha channel, but the first image of '{self.camera}' has one.")
        return image if self.has_alpha else np.ascontiguousarray(image[:, :, :3])

    def files(self, frames: Iterable[int] | None = None) -> list[Path]:
        """See `FrameSource`."""
        return [self._paths[frame] for frame in (self.frames if frames is None else frames) if frame in self._paths]

    def where(self, frame: int) -> str:
        """See `FrameSource`."""
        return str(self._paths.get(frame, f"frame {frame}"))


class ShiftedSource:
    """A `FrameSource` of a camera that was late or early: its frame f is the file's frame f + offset."""

    def __init__(self, source: FrameSource, offset: int) -> None:
        self.source = source
        self.offset = offset
        self.camera = source.camera
        self.frames = tuple(frame - offset for frame in source.frames)
        self.width, self.height = source.width, source.height
        self.has_alpha = source.has_alpha
        self.fps = source.fps

    def read(self, frame: int) -> np.ndarray:
        """See `FrameSource`."""
        return self.source.read(frame + self.offset)

    def files(self, frames: Iterable[int] | None = None) -> list[Path]:
        """See `FrameSource`."""
        return self.source.files(None if frames is None else [frame + self.offset for frame in frames])

    def where(self, frame: int) -> str:
        """See `FrameSource`."""
        return self.source.where(frame + self.offset)


class DecoderPool:
    """Keeps at most `limit` video decoders open: the least recently used closes first."""

    def __init__(self, limit: int) -> None:
        self.limit = max(1, limit)
        self._open: OrderedDict[int, VideoReader] = OrderedDict()
        self._lock = threading.Lock()

    def used(self, reader: VideoReader) -> None:
        """Say that `reader` is about to be read; may close others."""
        surplus: list[VideoReader] = []
        with self._lock:
            self._open[id(reader)] = reader
            self._open.move_to_end(id(reader))
            while len(self._open) > self.limit:
                surplus.append(self._open.popitem(last=False)[1])
        for other in surplus:
            other.close()

    def close(self) -> None:
        """Close all decoders."""
        with self._lock:
            readers = list(self._open.values())
            self._open.clear()
        for reader in readers:
            reader.close()


class VideoSource:
    """A `FrameSource` of one video; frames are numbered from 0."""

    def __init__(self, camera: str, path: Path, pool: DecoderPool, color_matrix: str = "auto") -> None:
        self.camera = camera
        self._pool = pool
        self.reader = VideoReader(path, color_matrix)
        pool.used(self.reader)
        self.frames = tuple(range(self.reader.frame_count))
        self.width, self.height = self.reader.width, self.reader.height
        self.has_alpha = self.reader.has_alpha
        self.fps = self.reader.fps

    def read(self, frame: int) -> np.ndarray:
        """See `FrameSource`."""
        self._pool.used(self.reader)
        return self.reader.read(frame)

    def files(self, frames: Iterable[int] | None = None) -> list[Path]:
        """See `FrameSource`."""
        return [self.reader.path]

    def where(self, frame: int) -> str:
        """See `FrameSource`."""
        return f"frame {frame} of {self.reader.path}"


def decoder_limit(width: int, height: int) -> int:
    """How many decoders for videos of this size may be open: a quarter of the free memory, at least four."""
    import psutil

    # A decoder holds up to 16 reference frames and a few more, at 1.5 bytes a pixel.
    each = width * height * 1.5 * 18 + (1 << 20)
    return max(4, int(psutil.virtual_memory().available / 4 / each))


def make_sources(
    matches: list[Match], pool: DecoderPool, color_matrix: str = "auto", offsets: Mapping[str, int] | None = None
) -> dict[str, FrameSource]:
    """A source a camera from the files that a pattern found; still images without `{frame}` become frame 0.

    `offsets` are the frames that cameras are late, as in `CaptureSpec`.

    Raises:
        StudioError: a file cannot be opened; a pattern with `{frame}` found videos; images and videos are mixed.
    """
    groups: dict[str, list[Match]] = {}
    for match in matches:
        groups.setdefault(match.camera, []).append(match)
    sources: dict[str, FrameSource] = {}
    for camera, group in groups.items():
        videos = [match for match in group if match.path.suffix.lower() in VIDEO_EXTENSIONS]
        if videos and (len(group) > 1 or videos[0].frame is not None):
            raise StudioError(
                f"Camera '{camera}': {videos[0].path} is a video, but the pattern takes it for one of several frames; "
                "leave {frame} out of the pattern for videos."
            )
        if videos:
            sources[camera] = VideoSource(camera, videos[0].path, pool, color_matrix)
        else:
            sources[camera] = ImageSource(camera, {match.frame or 0: match.path for match in group})
    if len({isinstance(source, VideoSource) for source in sources.values()}) > 1:
        kinds = {isinstance(source, VideoSource): camera for camera, source in sources.items()}
        raise StudioError(
            f"Camera '{kinds[True]}' is a video and camera '{kinds[False]}' is images; a capture must be one or the "
            "other: narrow the images pattern."
        )
    for camera, offset in (offsets or {}).items():
        if offset and camera in sources:
            sources[camera] = ShiftedSource(sources[camera], offset)
    return sources
