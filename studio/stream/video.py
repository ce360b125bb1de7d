"""A video of numbers: 8-bit luma in MP4 through PyAV. The same images give the same bytes."""

import contextlib
import io
import logging
import os
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.container import InputContainer

from v3studio.studio.errors import StudioError
from v3studio.studio.process import logged
from v3studio.studio.stream.sources.source import damaged

_LOG = logging.getLogger(__name__)

UNREADABLE = (av.error.FFmpegError, ValueError, IndexError, EOFError)  # what PyAV raises for a damaged file

NOMINAL_FPS = 30
"""Rate written into the MP4s, without meaning: image k is frame k of the group, and the manifest has the rate."""

_JPEG_RANGE = 2  # AVCOL_RANGE_JPEG: luma uses 0 to 255
_BT709 = 1  # AVCOL_PRI_BT709, AVCOL_TRC_BT709, AVCOL_SPC_BT709
_NEUTRAL = 128


def _bytes_of(plane: Any) -> np.ndarray:
    """(rows, bytes per row) uint8 view of a PyAV image plane; rows may be wider than the image."""
    return np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)


# One I frame. Psychovisual tuning (psy) helps images, not numbers. Scene cut detection would insert more I frames.
_PARAMETERS = "keyint=infinite:scenecut=0:bframes={b}:psy=0:threads=1:lookahead-threads=1:log=0"
# One image of many tiles: deblocking blurs across tiles, and a finer I frame does not pay off (measured).
_TILES = ":no-deblock=1:ipratio=1.0"
# Adaptive placement sees noise and chooses no B-frames at all: force them.
_B_FRAMES = ":b-adapt=0:pbratio=1.3"


class PlaneEncoder:
    """Encodes images of numbers: one I frame, then P, with B between them if wanted; constant QP; one thread, so
    that the bytes are reproducible.

    Luma is full range, chroma neutral (yuv420p, since few hardware decoders support gray). QP 0 is lossless. The
    container has neither dates nor library versions; x264 writes its own version into the bitstream.

    Args:
        qp: quantization parameter, 0 to 51.
        preset: x264's name of its effort.
        b_frames: B-frames between P-frames, each predicted from the one before and the one after. The file then has
            the images in another order than that of display; decoders return the order of display.
        fps: frames per second that the level is chosen for; the file then also has a `colr` box. None, for VideoGS:
            images without tiles, the level for `NOMINAL_FPS`, and no such box.
    """

    def __init__(
        self,
        path: Path,
        size: tuple[int, int],
        qp: int,
        preset: str,
        b_frames: int = 0,
        fps: float | None = None,
    ) -> None:
        self._width = size[0]
        self._frames = 0
        # bitexact: no "Lavf" tag. faststart: index before the data, so that playback can start early.
        own = {"fflags": "+bitexact", "movflags": "+faststart"}
        self._out = av.open(str(path), "w", format="mp4", options=own)
        rate = NOMINAL_FPS if fps is None else Fraction(fps).limit_denominator(1001)
        stream: Any = self._out.add_stream("libx264", rate=rate)
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.color_range = _JPEG_RANGE
        if fps is not None:  # the muxer writes `colr` if these are known; luma does not depend on them
            context.color_primaries = context.color_trc = context.colorspace = _BT709
        context.thread_count = 1
        parameters = _PARAMETERS.format(b=f"{b_frames}{_B_FRAMES}" if b_frames > 0 else "0")
        parameters += "" if fps is None else _TILES
        context.options = {"preset": preset, "qp": str(qp), "x264-params": parameters}
        _LOG.debug("x264 for %s: %dx%d, %s", path, *size, context.options)
        self._stream = stream
        self._picture = av.VideoFrame(*size, "yuv420p")
        for plane in self._picture.planes[1:]:
            _bytes_of(plane)[:] = _NEUTRAL

    def add(self, plane: np.ndarray) -> None:
        """Encode the next image, (height, width) uint8."""
        luma = self._picture.planes[0]
        _bytes_of(luma)[:, : self._width] = plane
        self._picture.pts = self._frames
        self._frames += 1
        for packet in self._stream.encode(self._picture):
            self._out.mux(packet)

    def close(self) -> None:
        with logged(_LOG, f"FFmpeg's last images of {self._out.name}"):
            for packet in self._stream.encode():
                self._out.mux(packet)
            self._out.close()

    def abandon(self) -> None:
        """Close the file after an error; its content is undefined."""
        with contextlib.suppress(OSError, ValueError):
            self._out.close()


@contextlib.contextmanager
def encoding(encoders: Sequence[PlaneEncoder], threads: int = 0) -> Iterator[ThreadPoolExecutor]:
    """A pool of threads (0: one per core) to add images with; in the end all `encoders` are closed, which may be opened
    within, or abandoned after an error."""
    try:  # around the pool: FFmpeg crashes if a file is closed while a thread writes it
        with ThreadPoolExecutor(threads or os.cpu_count() or 1, thread_name_prefix="encode") as pool:
            yield pool
            list(pool.map(PlaneEncoder.close, encoders))
    except BaseException:
        for encoder in encoders:
            encoder.abandon()
        raise


_NO_PROBING: Any = [{"skip_frame": "all"}]  # PyAV's own types are wrong here
"""Keeps FFmpeg from decoding the first image while probing, which took half of the time of opening. The manifest has
the information, and `PlaneDecoder` checks each image."""


class PlaneDecoder:
    """Decodes one video, held in memory, frame by frame in order; size and most images are from the manifest.

    More than one of `threads` decode several images in parallel. StudioError if it is not an MP4 with H.264 of
    that size, or has more images.
    """

    def __init__(self, data: bytes, name: str, size: tuple[int, int], pictures: int, threads: int = 1) -> None:
        self.name = name
        self._size = size
        self._lock = threading.Lock()  # FFmpeg crashes if a file is closed during decoding
        self._container: InputContainer | None = None
        try:
            container = self._container = av.open(io.BytesIO(data), "r", format="mp4", stream_options=_NO_PROBING)
            stream = container.streams.video[0]
            context = stream.codec_context
            if context is None:  # a codec unknown to FFmpeg
                raise ValueError("unknown codec")
            found = context.codec.canonical_name, context.width, context.height
        except UNREADABLE as error:
            self.close()
            raise damaged("stream.video_unreadable", f"not a readable MP4 video ({error})", name) from None
        if found != (expected := ("h264", *size)):
            self.close()
            problem = f"{found[0]} video of {found[1]}x{found[2]}; it must be h264 of {size[0]}x{size[1]}"
            raise damaged("stream.wrong_video", problem, name, found, expected=expected)
        if stream.frames > pictures:  # a group that costs more than its manifest promises
            count = stream.frames
            self.close()
            problem = f"the video has {count} pictures; the manifest says {pictures}"
            raise damaged("stream.video_too_long", problem, name, count, expected=pictures)
        context.thread_count = threads
        if threads > 1:
            context.thread_type = "FRAME"
        self._frames: Iterator[Any] = container.decode(stream)

    def read(self, out: np.ndarray) -> None:
        """Decode the next image into `out`, (height, width) uint8."""
        with self._lock:
            if self._container is None:
                raise StudioError("stream.closed", "the video was closed during decoding", file=self.name)
            try:
                frame: av.VideoFrame | None = next(self._frames, None)
            except UNREADABLE as error:
                raise damaged("stream.video_damaged", f"the video is damaged ({error})", self.name) from None
            if frame is None:
                raise damaged("stream.video_too_short", "the video has fewer frames than its group", self.name)
            if (frame.width, frame.height) != self._size or frame.format.name not in ("yuv420p", "yuvj420p", "gray"):
                size, wanted = f"{frame.width}x{frame.height}", f"{self._size[0]}x{self._size[1]}"
                problem = f"a picture is {size} {frame.format.name}; expected {wanted} yuv420p"
                raise damaged("stream.wrong_picture", problem, self.name)
            out[:] = _bytes_of(frame.planes[0])[:, : self._size[0]]

    def close(self) -> None:
        """Release the decoder as soon as no thread uses it."""
        with self._lock:
            if self._container is not None:
                self._container.close()
                self._container = None
