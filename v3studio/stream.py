"""The parts of `bake_video`, for streams that are baked group by group, and what a stream consists of."""

from v3studio.studio.stream import (
    CapturePlace,
    GroupEntry,
    Manifest,
    Rendition,
    Rung,
    StreamMetadata,
    bake_group,
    bake_set,
    bake_sound,
    write_manifest,
)

__all__ = [
    "CapturePlace",
    "GroupEntry",
    "Manifest",
    "Rendition",
    "Rung",
    "StreamMetadata",
    "bake_group",
    "bake_set",
    "bake_sound",
    "write_manifest",
]
