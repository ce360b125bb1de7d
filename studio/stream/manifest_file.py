"""The manifest's bytes: reading with all checks, writing with size and checksum, growing, and the JSON schema."""

import hashlib
from collections.abc import Sequence
from typing import Any

from pydantic import TypeAdapter, ValidationError

from v3studio.studio.bounded_files import Bounds, TextError, parse_json
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject
from v3studio.studio.stream.attributes import NAMES, VERSION
from v3studio.studio.stream.manifest import (
    FORMAT,
    MAX_MANIFEST_BYTES,
    GroupEntry,
    InconsistentError,
    Manifest,
    Page,
    PageEntry,
    invalid,
)
from v3studio.studio.stream.sources.source import BAKE_AGAIN, damaged

_BOUNDS = Bounds(size=MAX_MANIFEST_BYTES, values=2_000_000)
"""About 300 MB of memory; far more than groups in the manifest itself need, since most are in pages."""


def parse_manifest(data: bytes, name: str) -> Manifest:
    _check_head(data, name)
    try:
        manifest = Manifest.model_validate_json(data)
    except ValidationError as error:
        raise invalid(error, name, BAKE_AGAIN) from None
    digest = manifest.manifest_sha256
    if hashlib.sha256(data.replace(digest.encode(), b"0" * 64)).hexdigest() != digest:
        raise damaged(
            "manifest.wrong_checksum", "the file does not match its own SHA-256: it was damaged or edited", name
        )
    if not manifest.pages:
        check_total(manifest, _file_bytes(manifest, manifest.groups), len(data), name)
    return manifest


def _check_head(data: bytes, name: str) -> None:
    """Format and version first: their errors say more than those of the keys that another format lacks."""
    try:
        head = parse_json(data, _BOUNDS)
    except TextError as error:
        raise damaged("manifest.not_json", f"not valid JSON ({error})", name) from None
    if not isinstance(head, dict) or head.get("format") != FORMAT:
        fix = "Choose the folder of a baked stream."
        raise StudioError("manifest.wrong_format", f"not the manifest of a {FORMAT}", file=name, fix=fix)
    version = head.get("version")
    if version != VERSION:
        problem = f"the stream has format version {str(version)[:20]}; this program reads version {VERSION}"
        value = version if isinstance(version, int) else None
        fix = "Bake it again with this version of V3 Studio, or update V3 Studio."
        raise StudioError("manifest.wrong_version", problem, file=name, value=value, fix=fix, expected=VERSION)


def parse_page(
    data: bytes, page: PageEntry, manifest: Manifest, first_group: int, first_frame: int, name: str
) -> tuple[GroupEntry, ...]:
    """Parse and validate a page of the index, which the manifest says begins with this group and frame."""
    if hashlib.sha256(data).hexdigest() != page.sha256:
        raise damaged("stream.wrong_checksum", "SHA-256 differs from the manifest", name)
    try:
        groups = Page.model_validate_json(data).groups
        manifest.check_groups(groups, first_group, first_frame)
        if tuple(group.frame_count for group in groups) != page.frames:
            raise InconsistentError(
                "page_frames", "the page's groups do not have the frames that the manifest promises"
            )
    except ValidationError as error:
        raise invalid(error, name, BAKE_AGAIN) from None
    except InconsistentError as error:
        raise damaged("manifest.invalid", str(error), name, location="", rule=error.rule) from None
    return groups


def _file_bytes(manifest: Manifest, groups: Sequence[GroupEntry]) -> int:
    files = {file.path: file.bytes for group in groups for file in group.files}
    return sum(files.values()) + sum(file.bytes for file in manifest.fixed_files)


def check_total(manifest: Manifest, file_bytes: int, manifest_bytes: int, name: str) -> None:
    """Raises StudioError unless `total_bytes` is right. `file_bytes`: size of all files but the manifest, each once."""
    expected = file_bytes + manifest_bytes
    if manifest.total_bytes != expected:
        problem = f"total_bytes is {manifest.total_bytes}, but the listed files have {expected} bytes"
        raise damaged("manifest.wrong_total", problem, name, manifest.total_bytes, expected=expected)


def seal(manifest: Manifest, groups: Sequence[GroupEntry]) -> tuple[Manifest, bytes]:
    """The manifest with `total_bytes` and `manifest_sha256`, which depend on its own bytes, and these bytes; `groups`
    are all, also those in pages."""
    zeros = "0" * 64
    total = file_bytes = _file_bytes(manifest, groups)
    while True:  # the size includes its own digits; it only grows, so this converges after a few rounds
        draft = manifest.model_copy(update={"total_bytes": total, "manifest_sha256": zeros})
        data = draft.to_bytes()
        if file_bytes + len(data) == total:
            break
        total = file_bytes + len(data)
    digest = hashlib.sha256(data).hexdigest()
    sealed = draft.model_copy(update={"manifest_sha256": digest})
    head, _, tail = data.rpartition(zeros.encode())  # the last key: free texts before it may have zeros, too
    return sealed, head + digest.encode() + tail


def check_growth(old: Manifest, new: Manifest, name: str) -> None:
    """Raises StudioError unless a live stream's new manifest only adds groups to the old one."""
    kept = old.frame_counts
    changed = ["fps"] if old.fps != new.fps else []
    if [rendition.id for rendition in old.renditions] != [rendition.id for rendition in new.renditions]:
        changed.append("renditions")
    same = all(before.files == after.files for before, after in zip(old.groups, new.groups, strict=False))
    if new.frame_counts[: len(kept)] != kept or ("renditions" not in changed and not same):
        changed.append("groups")
    if changed:
        problem = f"the live stream was replaced by another one ({', '.join(changed)} differ)"
        raise StudioError("stream.live_changed", problem, file=name, value=changed, fix="Open the stream again.")


def manifest_schema() -> JsonObject:
    """JSON schema (2020-12) of the manifest and of its pages, and `NAMES`: published as `docs/stream.schema.json`. It
    cannot express constraints between values (sums, counts, order); see `docs/STREAM.md` for those."""
    kinds: TypeAdapter[Any] = TypeAdapter(Manifest | Page)
    schema = kinds.json_schema()
    definition = schema["$defs"]["Manifest"]
    definition["required"] = ["format", "version", *definition["required"]]
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["$comment"] = "Copyright (c) 2026 The V3 Studio authors. SPDX-License-Identifier: CC-BY-4.0"
    schema["title"] = "Manifest of a v3studio-stream"
    schema["x-names"] = NAMES
    return schema
