from .decoders import DecodedFrame, GroupDecoder, open_decoder
from .encode.bake import ContributionFn, FinetunedFn, bake_group, bake_sound
from .encode.quality import QualityFn
from .encode.write_manifest import write_manifest
from .integrity import StreamDamage, StreamIntegrity, check_stream
from .manifest import FORMAT, MANIFEST_NAME, VERSION, AudioEntry, GroupEntry, Manifest, Rendition, RenditionEntry
from .metadata import CapturePlace, StreamMetadata
from .reader import StreamReader, fetch_group
from .settings import DEFAULT_LADDER, BakeSettings, Rung
from .sound import StreamSound
from .sources.source import FolderSource, Source, SourceUnavailable, is_address

__all__ = [
    "DEFAULT_LADDER",
    "FORMAT",
    "MANIFEST_NAME",
    "VERSION",
    "AudioEntry",
    "BakeSettings",
    "CapturePlace",
    "ContributionFn",
    "DecodedFrame",
    "FinetunedFn",
    "FolderSource",
    "GroupDecoder",
    "GroupEntry",
    "Manifest",
    "QualityFn",
    "Rendition",
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
    "check_stream",
    "fetch_group",
    "is_address",
    "open_decoder",
    "write_manifest",
]
