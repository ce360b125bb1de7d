"""The poster: the first frame from the stream's suggested camera."""

from __future__ import annotations

from dataclasses import dataclass

from pipelines.share.stream_files import StreamToShare

WIDTH = 1200
"""Largest width in pixels: what link previews show at most."""

_QUALITY = 82  # of JPEG
_SIZE = (1200, 900)  # where the stream suggests no camera


@dataclass(frozen=True)
class Poster:
    """A JPEG image.

    Attributes:
        data: the file's bytes.
        size: width and height, pixels.
    """

    data: bytes
    size: tuple[int, int]


def draw_poster(stream: StreamToShare) -> Poster:
    """Render the first frame over the stream's background; without a suggested camera, from the front.

    Raises:
        StudioError: the first group is missing or damaged.
    """
    from pipelines.reports.pictures import draw, encode
    from pipelines.takes.videos import decoded_video
    from studio.formats.camera_path import turntable

    video = decoded_video(stream.reader)
    camera = video.view or turntable(video, *_SIZE)(0.0)
    image = draw(video.read(0), camera, video.background, width=WIDTH)
    return Poster(encode(image, ".jpg", _QUALITY), (image.shape[1], image.shape[0]))
