"""The stream: Gaussians baked into plane videos with a manifest, and read back. `docs/STREAM.md` is its description."""

from studio.stream.bake import bake_group, group_folder_name, write_manifest
from studio.stream.manifest import FORMAT, MANIFEST_NAME, VERSION, GroupEntry, Manifest
from studio.stream.reader import GroupDecoder, StreamReader, dequantise_planes, fetch_group
from studio.stream.settings import BakeSettings
from studio.stream.source import FolderSource, Source

__all__ = [
    "FORMAT",
    "MANIFEST_NAME",
    "VERSION",
    "BakeSettings",
    "FolderSource",
    "GroupDecoder",
    "GroupEntry",
    "Manifest",
    "Source",
    "StreamReader",
    "bake_group",
    "dequantise_planes",
    "fetch_group",
    "group_folder_name",
    "write_manifest",
]
