"""Opens media files for reading with FFmpeg: only the file itself is read, whatever it contains.

FFmpeg looks at the content, not at the name: a `cam01.mp4` that holds a playlist (ffconcat, HLS, DASH, SDP) would
make it open other files and addresses. Formats and protocols are therefore named (its options `format_whitelist` and
`protocol_whitelist`), and the name is marked as that of a file, since `http:` or `concat:` may begin one, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from studio.storage import cached_object

if TYPE_CHECKING:
    from av.container import InputContainer

    from studio.storage import CachedObject

FORMATS = (
    "mov", "mp4", "matroska", "webm", "avi", "mxf", "mpegts", "mpeg", "mpegvideo", "m4v", "asf", "ivf", "h264", "hevc",
    "mjpeg", "wav", "w64", "aiff", "flac", "ogg", "mp3", "aac",
)  # fmt: skip
"""Names of FFmpeg's demuxers of self-contained files."""


_OPTIONS = {"format_whitelist": ",".join(FORMATS)}


def open_media(path: Path | str) -> InputContainer:
    """Open a video or sound file.

    Raises:
        av.FFmpegError, OSError, ValueError: it is missing, damaged, or of another format.
    """
    import av

    stored = cached_object(Path(path))
    if stored is not None:
        return _open_stored(stored)
    return av.open(f"file:{path}", "r", container_options={**_OPTIONS, "protocol_whitelist": "file"})


@contextmanager
def open_packets(path: Path | str) -> Iterator[InputContainer]:
    """Open a file to list its packets: their times, sizes and flags, not their content.

    Of an MP4 in object storage, only the header is read, which has all of these; the content of packets that are not on
    this machine is zeros.

    Raises:
        av.FFmpegError, OSError, ValueError: as `open_media`.
    """
    stored = cached_object(Path(path))
    # FFmpeg's parser would take keyframes from the content instead of the header
    with open_media(path) if stored is None else _open_stored(stored, fflags="+noparse") as container:
        if stored is not None and "mp4" in container.format.name.split(","):
            stored.fetches = False
        yield container


def _open_stored(stored: CachedObject, **options: str) -> InputContainer:
    import av

    return av.open(stored, "r", container_options={**_OPTIONS, "protocol_whitelist": "none", **options})
