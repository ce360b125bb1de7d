"""Checks decoded pictures against the CRC-32 in the manifest."""

from __future__ import annotations

import zlib

import numpy as np

from studio.errors import StudioError
from studio.stream.ladder_models import CheckedPlane, CheckedVideo
from studio.stream.manifest_models import VideoEntry


def check_luma(video: VideoEntry, index: int, luma: np.ndarray, name: str) -> None:
    """Compare picture `index` of a video with its check, if it has one (streams of version 3).

    Args:
        video: its entry in the manifest.
        index: 0-based.
        luma: (height, width) uint8, contiguous.
        name: the stream, for messages.

    Raises:
        StudioError: `stream.wrong_luma`.
    """
    if not isinstance(video, CheckedVideo | CheckedPlane):
        return
    for check in video.checks:
        if check.picture == index and (found := zlib.crc32(luma.data)) != check.crc32:
            raise StudioError(
                "stream.wrong_luma",
                f"picture {index} is decoded to other values than the manifest says: the decoder is not exact, or the "
                "manifest is wrong",
                file=f"{name}/{video.path}",
                value=found,
                fix="Bake the stream again; if that does not help, install PyAV from PyPI.",
                expected=check.crc32,
                picture=index,
            )
