"""The published JSON schema matches the models."""

import json
from pathlib import Path

from studio.stream import BakeSettings, bake_group, write_manifest
from studio.stream.schema import manifest_schema

SCHEMA = Path(__file__).parents[3] / "docs" / "stream.schema.json"


def test_the_published_schema_is_the_programs():
    """After a change: write `manifest_schema()` to docs/stream.schema.json, indent 1, and describe it in STREAM.md."""
    assert json.loads(SCHEMA.read_text()) == manifest_schema()


def names(schema, kind):
    """Keys of a definition, and the required ones."""
    definition = schema["$defs"][kind]
    return set(definition["properties"]), set(definition["required"])


def test_a_written_manifest_has_the_keys_of_the_schema(tmp_path, make_frames):
    schema = json.loads(SCHEMA.read_text())
    for profile, kind, group_kind in (
        ("planes", "PlanesManifest", "PlanesGroup"),
        ("motion", "MotionManifest", "MotionGroup"),
    ):
        settings = BakeSettings(profile=profile, stream_version=2)
        folder = tmp_path / profile
        write_manifest(folder, [bake_group(make_frames(2, 50), folder, 0, 0, settings)], 25, settings)
        manifest = json.loads((folder / "manifest.json").read_text())
        known, needed = names(schema, kind)
        assert needed <= set(manifest) == known
        assert manifest["profile"] == schema["$defs"][kind]["properties"]["profile"]["const"] == profile
        known, needed = names(schema, group_kind)
        assert needed <= set(manifest["groups"][0]) == known - {"dilation"}  # left out where it is the usual one
