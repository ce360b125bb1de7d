"""Opening a group's files with the decoder of its profile."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

from studio.stream.decode_motion import MotionDecoder
from studio.stream.decode_planes import PlanesDecoder
from studio.stream.decoder import DecodedFrame, GroupDecoder
from studio.stream.manifest_models import GroupEntry, MotionGroup, PlanesGroup

__all__ = ["DecodedFrame", "GroupDecoder", "open_decoder"]


def open_decoder(
    group: GroupEntry,
    files: Mapping[str, bytes],
    pool: ThreadPoolExecutor,
    name: str,
    codec: str,
    threads: int = 1,
) -> GroupDecoder:
    """A decoder at the group's first frame.

    Args:
        group: its entry in the manifest.
        files: what `fetch_group` returned: content by path.
        pool: threads that decode several videos side by side.
        name: the stream, for messages.
        codec: the manifest's.
        threads: of a video decoder that works alone.

    Raises:
        StudioError: a file is not what the manifest promises.
    """
    if isinstance(group, PlanesGroup):
        return PlanesDecoder(group, files, pool, name)
    assert isinstance(group, MotionGroup)
    return MotionDecoder(group, files, name, codec, threads)
