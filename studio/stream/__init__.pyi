from .bake import bake_group, group_folder_name, write_manifest
from .bake_ladder import ContributionFn, FinetunedFn
from .bake_sound import bake_sound
from .decode import DecodedFrame, GroupDecoder, open_decoder
from .integrity import StreamDamage, StreamIntegrity, check_stream
from .ladder_models import AudioEntry, BakedGroup, GroupLadder, RenditionEntry, baked_group
from .manifest import FORMAT, MANIFEST_NAME, VERSION, Manifest
from .manifest_models import GroupEntry
from .metadata import CapturePlace, StreamMetadata
from .reader import StreamReader, fetch_group
from .search import QualityFn
from .settings import DEFAULT_LADDER, BakeSettings, Rung
from .sound import StreamSound
from .source import FolderSource, Source, SourceUnavailable, is_address

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
