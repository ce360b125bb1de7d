"""The stream: Gaussians baked into videos with a manifest, and read back. Specified in `docs/STREAM.md`."""

from typing import TYPE_CHECKING

from studio.lazy import lazy_exports

if TYPE_CHECKING:
    from studio.stream.bake import bake_group, group_folder_name, write_manifest
    from studio.stream.bake_ladder import ContributionFn, FinetunedFn
    from studio.stream.bake_sound import bake_sound
    from studio.stream.decode import DecodedFrame, GroupDecoder, open_decoder
    from studio.stream.integrity import StreamDamage, StreamIntegrity, check_stream
    from studio.stream.ladder_models import AudioEntry, BakedGroup, GroupLadder, RenditionEntry, baked_group
    from studio.stream.manifest import FORMAT, MANIFEST_NAME, VERSION, Manifest
    from studio.stream.manifest_models import GroupEntry
    from studio.stream.metadata import CapturePlace, StreamMetadata
    from studio.stream.reader import StreamReader, fetch_group
    from studio.stream.search import QualityFn
    from studio.stream.settings import DEFAULT_LADDER, BakeSettings, Rung
    from studio.stream.sound import StreamSound
    from studio.stream.source import FolderSource, Source, SourceUnavailable, is_address

__all__ = [
    "DEFAULT_LADDER",
    "FORMAT",
    "MANIFEST_NAME",
    "VERSION",
    "AudioEntry",
    "BakeSettings",
    "BakedGroup",
    "CapturePlace",
    "ContributionFn",
    "DecodedFrame",
    "FinetunedFn",
    "FolderSource",
    "GroupDecoder",
    "GroupEntry",
    "GroupLadder",
    "Manifest",
    "QualityFn",
    "RenditionEntry",
    "Rung",
    "Source",
    "SourceUnavailable",
    "StreamDamage",
    "StreamIntegrity",
    "StreamMetadata",
    "StreamReader",
    "StreamSound",
    "bake_group",
    "bake_sound",
    "baked_group",
    "check_stream",
    "fetch_group",
    "group_folder_name",
    "is_address",
    "open_decoder",
    "write_manifest",
]

lazy_exports(__name__)
