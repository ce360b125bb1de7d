"""One video of numbers: luma in MP4 through PyAV, written so that the same pictures give the same bytes, and read back.

PyAV is imported where it is used, so that importing the package stays quick.
"""

from __future__ import annotations

import contextlib
import io
import os
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from studio.errors import StudioError
from studio.stream.settings import PRESETS, QP_MAX

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


@dataclass(frozen=True)
class _Codec:
    """How FFmpeg's encoders are told the same thing: constant QP, I then P, one thread, nothing tuned for eyes.

    Attributes:
        encoder: FFmpeg's name.
        key: name of the option that takes the parameters.
        parameters: for any QP above 0; {qp} is filled in.
        lossless: for QP 0; None where that is not offered.
        tag: four letters that name it in the MP4, where FFmpeg's choice is not the one that players know.
    """

    encoder: str
    key: str
    parameters: str
    lossless: str | None
    tag: str | None = None


# Psychovisual tricks (psy) serve eyes, not numbers. Scene cuts would set further I frames.
_X264 = "keyint=infinite:scenecut=0:bframes=0:psy=0:threads=1:lookahead-threads=1:log=0"
# One picture of many tiles: deblocking only blurs them into each other, and a better I frame does not pay (measured).
_X264_TILES = f"{_X264}:no-deblock=1:ipratio=1.0"
_X265_TILES = (
    "keyint=-1:scenecut=0:bframes=0:psy-rd=0:psy-rdoq=0:aq-mode=0:cutree=0:ipratio=1.0:no-deblock=1:no-sao=1:"
    "frame-threads=1:pools=none:no-wpp=1:info=0:log-level=none"
)
_PLANES = _Codec("libx264", "x264-params", _X264, _X264)
_TILES = {
    "h264": _Codec("libx264", "x264-params", _X264_TILES, _X264_TILES),
    "hevc": _Codec("libx265", "x265-params", f"qp={{qp}}:{_X265_TILES}", f"lossless=1:{_X265_TILES}", "hvc1"),
    "av1": _Codec(
        "libsvtav1", "svtav1-params", "rc=0:aq-mode=0:qp={qp}:pred-struct=1:keyint=-1:lp=1:enable-tf=0", None
    ),
}
# SVT-AV1 numbers its presets; these take about as long as x264's of the same name.
_AV1_PRESETS = {name: str(number) for name, number in zip(PRESETS, (12, 11, 10, 10, 9, 8, 7, 6, 5), strict=True)}
AV1_QP_MAX = 63


def codec_qp(codec: str, qp: int) -> int:
    """The QP on the codec's own scale: H.264's and HEVC's ends at 51, AV1's at 63."""
    return round(qp * AV1_QP_MAX / QP_MAX) if codec == "av1" else qp


class PlaneEncoder:
    """Encodes pictures of numbers: the first is I, the others P; constant QP; one thread (so the bytes never vary).

    Luma is full range, chroma neutral (yuv420p, because hardware decoders rarely take gray). QP 0 is lossless.
    Neither dates nor library versions are written into the container; x264 puts its own version into the stream.

    Args:
        path: the file.
        size: width and height.
        qp: on H.264's scale.
        preset: one of `settings.PRESETS`.
        tiles: codec of a picture of many tiles; None for one plane of the profile `planes`.
    """

    def __init__(self, path: Path, size: tuple[int, int], qp: int, preset: str, tiles: str | None = None) -> None:
        import av

        codec = _PLANES if tiles is None else _TILES[tiles]
        parameters = codec.lossless if qp == 0 else codec.parameters
        assert parameters is not None
        if tiles == "av1":
            os.environ.setdefault("SVT_LOG", "1")  # errors only: the library writes to stderr past FFmpeg's log level
        self._width = size[0]
        self._frames = 0
        # bitexact: no "Lavf" tag. faststart: the index before the data, so that a player can begin early.
        options = {"fflags": "+bitexact", "movflags": "+faststart"}
        self._out = av.open(str(path), "w", format="mp4", options=options)
        stream: Any = self._out.add_stream(codec.encoder, rate=NOMINAL_FPS)
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.color_range = _JPEG_RANGE
        context.thread_count = 1
        if codec.tag is not None:
            context.codec_tag = codec.tag
        context.options = {
            "preset": _AV1_PRESETS[preset] if tiles == "av1" else preset,
            codec.key: parameters.format(qp=codec_qp(tiles or "h264", qp)),
        }
        if codec.encoder == "libx264":
            context.options["qp"] = str(qp)
        self._stream = stream
        self._picture = av.VideoFrame(*size, "yuv420p")
        for plane in self._picture.planes[1:]:
            _bytes_of(plane)[:] = _NEUTRAL

    def add(self, plane: np.ndarray) -> None:
        """Encode the next picture, (height, width) uint8."""
        luma = self._picture.planes[0]
        _bytes_of(luma)[:, : self._width] = plane
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


_NO_PROBING: Any = [{"skip_frame": "all"}]  # PyAV's own types are wrong here
"""FFmpeg decodes the first picture to learn what the manifest tells already, half of the time that opening took. It
holds for that probing only; `PlaneDecoder` checks each picture."""


class PlaneDecoder:
    """Decodes one plane's file, held in memory, frame by frame in order.

    Args:
        data: the whole file.
        name: for messages.
        size: width and height that the manifest says; another picture size is an error.
        codec: h264, hevc or av1, what the manifest says.
        threads: of the decoder; more than one decode several pictures at once.

    Raises:
        StudioError: not an MP4 of that codec, or another picture size.
    """

    def __init__(self, data: bytes, name: str, size: tuple[int, int], codec: str = "h264", threads: int = 1) -> None:
        import av

        self._errors: tuple[type[BaseException], ...] = (av.error.FFmpegError, ValueError, IndexError, EOFError)
        self.name = name
        self._size = size
        self._lock = threading.Lock()  # FFmpeg crashes if a file is closed while it is decoded
        self._container: InputContainer | None = None
        try:
            container = self._container = av.open(io.BytesIO(data), "r", format="mp4", stream_options=_NO_PROBING)
            stream = container.streams.video[0]
            context = stream.codec_context
            if context is None:  # a codec that FFmpeg does not know
                raise ValueError("its codec is not known")
            found, found_size = context.codec.canonical_name, (context.width, context.height)
        except self._errors as error:
            self.close()
            raise StudioError(f"{name}: this is not a readable MP4 video ({error}); bake or fetch it again.") from None
        if found != codec or found_size != size:
            self.close()
            raise StudioError(
                f"{name}: found {found} video of {found_size[0]}x{found_size[1]}, the manifest promises {codec} of "
                f"{size[0]}x{size[1]}; bake or fetch the stream again."
            )
        context.thread_count = threads
        if threads > 1:
            context.thread_type = "FRAME"
        self._frames: Iterator[Any] = container.decode(stream)

    def read(self, out: np.ndarray) -> None:
        """Decode the next picture into `out`, (height, width) uint8.

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
        if (frame.width, frame.height) != self._size or frame.format.name not in (
            "yuv420p",
            "yuvj420p",
            "gray",
        ):
            raise StudioError(
                f"{self.name}: a frame is {frame.width}x{frame.height} {frame.format.name}, expected "
                f"{self._size[0]}x{self._size[1]} yuv420p; bake or fetch it again."
            )
        out[:] = _bytes_of(frame.planes[0])[:, : self._size[0]]

    def close(self) -> None:
        """Free the decoder, as soon as no thread reads from it."""
        with self._lock:
            if self._container is not None:
                self._container.close()
                self._container = None
