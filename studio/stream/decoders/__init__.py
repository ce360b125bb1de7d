"""Opens a group with the decoder of its profile."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

from v3studio.studio.stream.decoders.decoder import DecodedFrame, GroupDecoder
from v3studio.studio.stream.decoders.motion import MotionDecoder
from v3studio.studio.stream.decoders.planes import PlanesDecoder
from v3studio.studio.stream.manifest import MotionRendition, PlanesRendition, Rendition

__all__ = ["DecodedFrame", "GroupDecoder", "open_decoder"]


def open_decoder(
    group: Rendition, files: Mapping[str, bytes], pool: ThreadPoolExecutor, name: str, codec: str, threads: int = 1
) -> GroupDecoder:
    """A decoder at the group's first frame; StudioError if a file does not match the manifest. `files`: content by
    path, from `StreamReader.fetch`; `pool`: threads that decode several videos in parallel, while `threads` are of the
    decoder of a single one; `name`: the stream, for messages."""
    if isinstance(group, PlanesRendition):
        return PlanesDecoder(group, files, pool, name)
    assert isinstance(group, MotionRendition)
    return MotionDecoder(group, files, name, codec, threads)
