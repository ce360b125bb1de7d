"""Opens media files for reading with FFmpeg: only the file itself is read, whatever it contains.

FFmpeg looks at the content, not at the name: a `cam01.mp4` that holds a playlist (ffconcat, HLS, DASH, SDP) would
make it open other files and addresses. Formats and protocols are therefore named (its options `format_whitelist` and
`protocol_whitelist`), and the name is marked as that of a file, since `http:` or `concat:` may begin one, too.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from av.container import InputContainer

FORMATS = (
    "mov", "mp4", "matroska", "webm", "avi", "mxf", "mpegts", "mpeg", "mpegvideo", "m4v", "asf", "ivf", "h264", "hevc",
    "mjpeg", "wav", "w64", "aiff", "flac", "ogg", "mp3", "aac",
)  # fmt: skip
"""Names of FFmpeg's demuxers of self-contained files."""


def open_media(path: Path | str) -> InputContainer:
    """Open a video or sound file.

    Raises:
        av.FFmpegError, OSError, ValueError: it is missing, damaged, or of another format.
    """
    import av

    options = {"format_whitelist": ",".join(FORMATS), "protocol_whitelist": "file"}
    return av.open(f"file:{path}", "r", container_options=options)
