"""One plane's video: H.264 in MP4 through PyAV, written so that the same planes give the same bytes, and read back.

PyAV is imported where it is used, so that importing the package stays quick.
"""

from __future__ import annotations

import contextlib
import io
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from studio.errors import StudioError

if TYPE_CHECKING:
    from collections.abc import Iterator

    import av
    from av.container import InputContainer

NOMINAL_FPS = 30
"""Rate written into the MP4s. It means nothing: picture k is frame k of the group, and the manifest has the rate."""

_JPEG_RANGE = 2  # AVCOL_RANGE_JPEG: luma uses 0 to 255
_NEUTRAL = 128


def _bytes_of(plane: Any) -> np.ndarray:
    """(rows, bytes a row) uint8 view of a PyAV picture plane; rows may be longer than the picture."""
    return np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)


class PlaneEncoder:
    """Encodes one plane's frames: the first is I, the others P; constant QP; one thread (so the bytes never vary).

    Luma is full range, chroma neutral (yuv420p, because hardware decoders rarely take gray). QP 0 is lossless.
    Neither dates nor library versions are written into the container; x264 puts its own version into the stream.
    """

    def __init__(self, path: Path, side: int, qp: int, preset: str) -> None:
        import av

        self._av = av
        self._side = side
        self._frames = 0
        # bitexact: no "Lavf" tag. faststart: the index before the data, so that a player can begin early.
        options = {"fflags": "+bitexact", "movflags": "+faststart"}
        self._out = av.open(str(path), "w", format="mp4", options=options)
        stream = self._out.add_stream("libx264", rate=NOMINAL_FPS)
        stream.width = stream.height = side
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.color_range = _JPEG_RANGE
        context.thread_count = 1
        # Psychovisual tricks (psy) serve eyes, not numbers. Scene cuts would set further I frames.
        context.options = {
            "preset": preset,
            "qp": str(qp),
            "x264-params": "keyint=infinite:scenecut=0:bframes=0:psy=0:threads=1:lookahead-threads=1:log=0",
        }
        self._stream = stream
        self._picture = av.VideoFrame(side, side, "yuv420p")
        for plane in self._picture.planes[1:]:
            _bytes_of(plane)[:] = _NEUTRAL

    def add(self, plane: np.ndarray) -> None:
        """Encode the next frame, (side, side) uint8."""
        luma = self._picture.planes[0]
        _bytes_of(luma)[:, : self._side] = plane
        self._picture.pts = self._frames
        self._frames += 1
        for packet in self._stream.encode(self._picture):
            self._out.mux(packet)

    def close(self) -> None:
        """Write what is left and close the file."""
        for packet in self._stream.encode():
            self._out.mux(packet)
        self._out.close()

    def abandon(self) -> None:
        """Close the file without caring what is in it (after an error)."""
        with contextlib.suppress(OSError, ValueError):
            self._out.close()


class PlaneDecoder:
    """Decodes one plane's file, held in memory, frame by frame in order.

    Args:
        data: the whole file.
        name: for messages.
        side: what the manifest says; another picture size is an error.

    Raises:
        StudioError: not an H.264 MP4, or another picture size.
    """

    def __init__(self, data: bytes, name: str, side: int) -> None:
        import av

        self._errors: tuple[type[BaseException], ...] = (av.error.FFmpegError, ValueError, IndexError, EOFError)
        self.name = name
        self._side = side
        self._lock = threading.Lock()  # FFmpeg crashes if a file is closed while it is decoded
        self._container: InputContainer | None = None
        try:
            container = self._container = av.open(io.BytesIO(data), "r", format="mp4")
            stream = container.streams.video[0]
            context = stream.codec_context
            codec, size = context.codec.canonical_name, (context.width, context.height)
        except self._errors as error:
            self.close()
            raise StudioError(f"{name}: this is not a readable MP4 video ({error}); bake or fetch it again.") from None
        if codec != "h264" or size != (side, side):
            self.close()
            raise StudioError(
                f"{name}: found {codec} video of {size[0]}x{size[1]}, the manifest promises h264 of {side}x{side}; "
                "bake or fetch the stream again."
            )
        context.thread_count = 1  # planes are decoded side by side; threads within one would only get in the way
        self._frames: Iterator[Any] = container.decode(stream)

    def read(self, out: np.ndarray) -> None:
        """Decode the next frame into `out`, (side, side) uint8.

        Raises:
            StudioError: the file is damaged or has no further frame.
        """
        with self._lock:
            self._read(out)

    def _read(self, out: np.ndarray) -> None:
        if self._container is None:
            raise StudioError(f"{self.name}: the video was closed while it was being read.")
        try:
            frame: av.VideoFrame | None = next(self._frames, None)
        except self._errors as error:
            raise StudioError(f"{self.name}: the video is damaged ({error}); bake or fetch it again.") from None
        if frame is None:
            raise StudioError(f"{self.name}: the video ends before the group does; bake or fetch it again.")
        if (frame.width, frame.height) != (self._side, self._side) or frame.format.name not in (
            "yuv420p",
            "yuvj420p",
            "gray",
        ):
            raise StudioError(
                f"{self.name}: a frame is {frame.width}x{frame.height} {frame.format.name}, expected "
                f"{self._side}x{self._side} yuv420p; bake or fetch it again."
            )
        out[:] = _bytes_of(frame.planes[0])[:, : self._side]

    def close(self) -> None:
        """Free the decoder, as soon as no thread reads from it."""
        with self._lock:
            if self._container is not None:
                self._container.close()
                self._container = None
