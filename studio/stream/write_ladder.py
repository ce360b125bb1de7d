"""Writes the manifest of version 3 with the pages of its index, and removes what it no longer needs."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from pydantic import ValidationError

from studio.atomic_files import sync, write_bytes
from studio.errors import StudioError
from studio.json_types import JsonObject
from studio.stream.bake_ladder import content_name
from studio.stream.group_index import GroupIndex
from studio.stream.ladder_manifest import (
    LADDER_PROFILES,
    PAGES,
    LadderManifest,
    compact,
    distinct_bytes,
    parse_ladder,
    seal_ladder,
)
from studio.stream.ladder_models import FILES, MAX_PAGE_GROUPS, AudioEntry, GroupLadder, PageEntry, RenditionEntry
from studio.stream.manifest import MANIFEST_NAME, Codec, Manifest, parse_head, parse_manifest
from studio.stream.manifest_models import MAX_MANIFEST_BYTES, invalid
from studio.stream.settings import BakeSettings
from studio.stream.source import FolderSource

INLINE_BYTES = 12 << 10
"""Groups in the manifest itself take this many bytes at most, unless the first is larger: what a player must have
before the first group. A manifest of 14 kB is what a server sends in the first round trip (ten segments, RFC 6928)."""

PAGE_BYTES = 256 << 10
"""The same for a page, which a player must have after seeking."""


def write_ladder(
    directory: Path,
    groups: Sequence[GroupLadder],
    fps: float,
    settings: BakeSettings,
    metadata: JsonObject,
    live: bool,
    audio: AudioEntry | None = None,
) -> Manifest:
    """Write pages, then the manifest, then remove unused files. Arguments as for `bake.write_manifest`.

    Raises:
        StudioError: groups out of order or with other renditions, or a file cannot be written.
    """
    path = directory / MANIFEST_NAME
    box = groups[0].best.bounding_box
    for one in (one for group in groups for one in group.renditions):
        box = box.union(one.bounding_box)
    sizes = [len(compact(group.to_dict())) for group in groups]
    inline = _fitting(sizes, 0, INLINE_BYTES)
    try:
        pages = _pages(directory, groups, sizes, inline, settings.profile)
        draft = LADDER_PROFILES[settings.profile](
            codec=Codec.model_validate({"name": settings.codec}),
            fps=fps,
            frame_count=sum(group.frame_count for group in groups),
            bounding_box=box,
            live=live,
            renditions=_renditions(groups, fps),
            groups=tuple(groups[:inline]),
            pages=pages,
            audio=audio,
            settings=settings.to_dict(),
            metadata=metadata,
            total_bytes=1,
            manifest_sha256="0" * 64,
        )
        manifest, data = seal_ladder(draft, distinct_bytes(groups))
        index = GroupIndex(manifest, FolderSource(directory), len(data))
        for number in range(len(groups)):  # what a reader of the pages would refuse
            index.ladder(number)
    except (ValueError, TypeError) as error:
        raise StudioError(
            "bake.manifest_invalid", f"the manifest is invalid ({first_finding(error)})", file=path
        ) from None
    before, kept = _files_before(path), _live_pages(path)
    wanted = {file.path for group in groups for file in group.files}
    replace_manifest(path, data, wanted | _other_files(manifest))
    _remove_unused(directory, before, wanted | kept | _other_files(manifest))
    return index.view(None)


def _fitting(sizes: Sequence[int], start: int, limit: int) -> int:
    """End of the longest run from `start` whose sizes sum to `limit` at most; at least one item."""
    end, total = start, 0
    while end < len(sizes) and end - start < MAX_PAGE_GROUPS and (end == start or total + sizes[end] <= limit):
        total += sizes[end]
        end += 1
    return end


def _pages(
    directory: Path, groups: Sequence[GroupLadder], sizes: Sequence[int], start: int, profile: str
) -> tuple[PageEntry, ...]:
    pages = []
    while start < len(groups):
        end = _fitting(sizes, start, PAGE_BYTES)
        part = tuple(groups[start:end])
        data = PAGES[profile](groups=part).to_bytes()
        name, digest = content_name(data, ".json")
        _write(directory / name, data)
        pages.append(
            PageEntry(path=name, bytes=len(data), sha256=digest, frames=tuple(group.frame_count for group in part))
        )
        start = end
    return tuple(pages)


def _renditions(groups: Sequence[GroupLadder], fps: float) -> tuple[RenditionEntry, ...]:
    found = []
    for column in zip(*(group.renditions for group in groups), strict=True):
        measured = [one for one in column if one.psnr_to_trained is not None]
        frames = sum(one.frame_count for one in measured)
        psnr = sum((one.psnr_to_trained or 0) * one.frame_count for one in measured) / frames if frames else None
        found.append(
            RenditionEntry(
                id=column[0].id,
                qp=max(one.qp for one in column),
                splats=max(one.splats for one in column),
                sh_degree=column[0].sh_degree,
                pruning=column[0].pruning,
                psnr_to_trained=None if psnr is None else round(psnr, 3),
                bytes=sum(one.bytes for one in column),
                bandwidth=max(math.ceil(8 * one.bytes * fps / one.frame_count) for one in column),
            )
        )
    return tuple(found)


def _write(path: Path, data: bytes) -> None:
    try:
        write_bytes(path, data)
    except OSError as error:
        raise StudioError("bake.write_failed", f"cannot be written ({error.strerror or error})", file=path) from None


def replace_manifest(path: Path, data: bytes, files: Iterable[str]) -> None:
    """Write the manifest, atomically, once the files that it names are on the disk: a power cut leaves the old stream
    or the new one.

    Args:
        path: the manifest.
        data: its bytes.
        files: paths in the stream's folder.

    Raises:
        StudioError: it cannot be written.
    """
    named = sorted({path.parent / name for name in files})
    try:
        for one in (*named, *sorted({one.parent for one in named} | {path.parent})):
            sync(one)
        write_bytes(path, data, durable=True)
        sync(path.parent)
    except OSError as error:
        raise StudioError(
            "bake.write_failed", f"the manifest cannot be written ({error.strerror or error})", file=path
        ) from None


def _files_before(path: Path) -> set[str]:
    """Files of the stream of version 1 or 2 that is replaced; empty if there is none."""
    try:
        with path.open("rb") as handle:
            data = handle.read(MAX_MANIFEST_BYTES)
        if parse_head(data, str(path)).get("version") == 3:
            return set()  # its files are in the folder of hashed files
        return {file.path for group in parse_manifest(data, str(path)).groups for file in group.files}
    except (OSError, StudioError):
        return set()


def _live_pages(path: Path) -> set[str]:
    """Pages of the live manifest that is replaced: players that follow may still need them, until they read the new
    one."""
    try:
        with path.open("rb") as handle:
            data = handle.read(MAX_MANIFEST_BYTES)
        if parse_head(data, str(path)).get("version") != 3:
            return set()
        old = parse_ladder(data, str(path))
        return {page.path for page in old.pages} if old.live else set()
    except (OSError, StudioError):
        return set()


def _other_files(manifest: LadderManifest) -> set[str]:
    """Pages and sound."""
    return {page.path for page in manifest.pages} | ({manifest.audio.path} if manifest.audio is not None else set())


def _remove_unused(directory: Path, before: set[str], used: set[str]) -> None:
    with contextlib.suppress(OSError):  # the stream is complete; what stays only takes room
        for found in (directory / FILES).iterdir():
            if f"{FILES}/{found.name}" not in used and found.is_file():
                found.unlink()
        for name in before - used:
            (directory / name).unlink(missing_ok=True)
        for folder in {(directory / name).parent for name in before} - {directory}:
            if folder.is_dir() and not any(folder.iterdir()):
                folder.rmdir()


def first_finding(error: Exception) -> str:
    """What a failed validation found first."""
    if isinstance(error, ValidationError):
        return invalid(error, "", "").problem
    return str(error)
