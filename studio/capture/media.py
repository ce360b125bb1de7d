"""Opens media files for reading with FFmpeg: only the file itself is read, whatever it contains.

FFmpeg looks at the content, not at the name: a `cam01.mp4` that holds a playlist (ffconcat, HLS, DASH, SDP) would
make it open other files and addresses. Formats and protocols are therefore named (its options `format_whitelist` and
`protocol_whitelist`), and the name is marked as that of a file, since `http:` or `concat:` may begin one, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.studio.storage import cached_object

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

    from v3studio.studio.storage import CachedObject

FORMATS = (
    "mov", "mp4", "matroska", "webm", "avi", "mxf", "mpegts", "mpeg", "mpegvideo", "m4v", "asf", "ivf", "h264", "hevc",
    "mjpeg", "wav", "w64", "aiff", "flac", "ogg", "mp3", "aac",
)  # fmt: skip
"""Names of FFmpeg's demuxers of self-contained files."""

_ALPHA_DECODERS = {"vp8": "libvpx", "vp9": "libvpx-vp9"}
"""FFmpeg's own decoders of these codecs ignore the alpha channel, which WebM files hold beside the frames."""

_STILLS = frozenset({"mjpeg", "png", "bmp", "gif", "tiff", "webp"})

_OPTIONS = {"format_whitelist": ",".join(FORMATS)}


def open_media(path: Path | str) -> InputContainer:
    """Open a video or sound file. Raises av.FFmpegError, OSError, ValueError: missing, damaged or unknown."""
    import av

    stored = cached_object(Path(path))
    if stored is not None:
        return _open_stored(stored)
    return av.open(f"file:{path}", "r", container_options={**_OPTIONS, "protocol_whitelist": "file"})


@contextmanager
def open_packets(path: Path | str) -> Iterator[InputContainer]:
    """Open a file to list its packets: their times, sizes and flags, not their content; raises as `open_media`. Of an
    MP4 in object storage, only the header is read, which has all of these; the content of packets that are not on this
    machine is zeros."""
    stored = cached_object(Path(path))
    # FFmpeg's parser would take keyframes from the content instead of the header
    with open_media(path) if stored is None else _open_stored(stored, fflags="+noparse") as container:
        if stored is not None and "mp4" in container.format.name.split(","):
            stored.fetches = False
        yield container


def _open_stored(stored: CachedObject, **options: str) -> InputContainer:
    import av

    return av.open(stored, "r", container_options={**_OPTIONS, "protocol_whitelist": "none", **options})


def video_stream(container: InputContainer) -> VideoStream | None:
    """The stream with the footage: not cover art or thumbnails, and the largest of several, as others are previews.
    None if there is no video whose codec FFmpeg knows.

    A stream other than the first that is the only one marked as default precedes. Programs mark the first one without
    being asked to, so that this mark says nothing.
    """
    from av.stream import Disposition

    pictures = Disposition.attached_pic | Disposition.timed_thumbnails | Disposition.still_image | Disposition.dependent
    known: list[VideoStream] = [stream for stream in container.streams.video if stream.codec_context is not None]
    films = [stream for stream in known if not stream.disposition & pictures]
    marked = [stream for stream in films if stream.disposition & Disposition.default]
    if len(marked) == 1 and marked[0] is not films[0]:
        return marked[0]
    # stills that are not marked as cover art come last; Matroska does not tell how many frames there are
    moving = [each for each in films if each.frames > 1 or each.codec_context.codec.name not in _STILLS]
    return max(moving or films, key=lambda stream: stream.width * stream.height, default=None)


def start_of(stream: Any) -> float:
    """Seconds at which a stream begins."""
    return float(stream.start_time * stream.time_base) if stream.start_time is not None else 0.0


def decoded(container: InputContainer, stream: VideoStream) -> Iterator[VideoFrame]:
    """The frames of a stream from here on, with alpha if it has it. Raises av.FFmpegError, OSError, ValueError."""
    from av.codec import CodecContext

    # each decoder has one thread: a capture keeps many open, and each frame thread needs a frame buffer of its own
    own = _ALPHA_DECODERS.get(stream.codec_context.codec.name)
    if own is None or stream.metadata.get("alpha_mode") != "1":  # as WebM marks alpha beside the frames
        if not stream.codec_context.is_open:
            stream.codec_context.thread_count = 1
        yield from container.decode(stream)
        return
    decoder: Any = CodecContext.create(own, "r")
    decoder.extradata = stream.codec_context.extradata
    decoder.thread_count = 1
    for packet in container.demux(stream):
        yield from decoder.decode(packet)
