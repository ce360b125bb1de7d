"""The published JSON schema of the manifest."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from studio.json_types import JsonObject
from studio.stream.ladder_manifest import MotionLadderManifest, MotionPage, PlanesLadderManifest, PlanesPage
from studio.stream.manifest import MotionManifest, PlanesManifest


def manifest_schema() -> JsonObject:
    """JSON schema (2020-12) of the manifest of all versions and of the pages of version 3, published as
    `docs/stream.schema.json`. It cannot express constraints between values (sums, counts, order); see `docs/STREAM.md`
    for those."""
    kinds: TypeAdapter[Any] = TypeAdapter(
        PlanesManifest | MotionManifest | PlanesLadderManifest | MotionLadderManifest | PlanesPage | MotionPage
    )
    schema = kinds.json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "Manifest of a v3studio-stream"
    return schema
