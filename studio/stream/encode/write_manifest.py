"""Writes the manifest with the pages of its index, and removes what it no longer needs."""

import contextlib
import math
from collections.abc import Iterable, Sequence
from functools import reduce
from pathlib import Path

from pydantic import ValidationError

from v3studio.studio.atomic_files import sync, write_bytes
from v3studio.studio.bounded_files import read_bounded
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject
from v3studio.studio.stream.encode.files import entry_of
from v3studio.studio.stream.manifest import (
    FILES,
    MANIFEST_NAME,
    MAX_MANIFEST_BYTES,
    MAX_PAGE_GROUPS,
    PAGE_FORMAT,
    AudioEntry,
    Box,
    FileEntry,
    GroupEntry,
    Manifest,
    Page,
    PageEntry,
    Rendition,
    RenditionEntry,
    invalid,
)
from v3studio.studio.stream.manifest_file import parse_manifest, seal
from v3studio.studio.stream.metadata import with_plain_texts
from v3studio.studio.stream.settings import BakeSettings

INLINE_BYTES = 12 << 10
"""Groups in the manifest itself take this many bytes at most, unless the first is larger: what a player must have
before the first group. A manifest of 14 KB is what a server sends in the first round trip (ten segments, RFC 6928)."""

PAGE_BYTES = 256 << 10  # the same for a page, which a player must have after seeking


def write_manifest(
    directory: Path | str,
    groups: Sequence[GroupEntry],
    fps: float,
    settings: BakeSettings,
    metadata: JsonObject | None = None,
    live: bool = False,
    audio: AudioEntry | None = None,
    behind: Sequence[Rendition] = (),
) -> Manifest:
    """Write pages, then `directory/manifest.json`, atomically, then remove files that the new manifest does not need.

    Args:
        directory: the stream's folder, which contains the groups' files.
        groups: entries from `bake_group`, in order and without gaps from frame 0.
        fps: frames per second.
        settings: as passed to `bake_group`.
        metadata: free-form JSON values. Leave out what changes between runs, such as dates, to keep the bytes
            reproducible. `StreamMetadata.to_json` makes those that players know. Control and bidirectional characters
            are removed from texts that are shown (`TEXTS`).
        live: further groups will follow.
        audio: the sound, from `bake_sound`; no longer than the frames.
        behind: the set, from `bake_set`.

    Returns:
        The manifest, including the total size of all files.

    Raises:
        StudioError: groups out of order or with other renditions, or a file is missing or has a
            different size, or cannot be written.
    """
    directory = Path(directory)
    path = directory / MANIFEST_NAME
    if not groups:
        raise StudioError("bake.no_groups", "a stream needs at least one group", file=path)
    if not (math.isfinite(fps) and fps > 0):
        raise StudioError("bake.manifest_invalid", f"fps is {fps}; it must be above 0", file=path, value=fps)
    _check_present(directory, groups, audio, behind)
    box = reduce(Box.union, (rendition.bounding_box for group in groups for rendition in group.renditions))
    sizes = [len(group.to_bytes()) for group in groups]
    inline = _fitting(sizes, 0, INLINE_BYTES)
    try:
        draft = Manifest(
            fps=float(fps),
            frame_count=sum(group.frame_count for group in groups),
            bounding_box=box,
            live=live,
            renditions=_renditions(groups, fps),
            groups=tuple(groups[:inline]),
            pages=_pages(directory, groups, sizes, inline),
            set=tuple(behind),
            audio=audio,
            settings=settings.to_dict(),
            metadata=with_plain_texts(metadata or {}),
            total_bytes=1,
            manifest_sha256="0" * 64,
        )
        manifest, data = seal(draft, groups)
        manifest.check_groups(groups, 0, 0)  # those in pages, too
        other = {file.path for file in manifest.fixed_files}
        wanted = {file.path for group in groups for file in group.files} | other
        kept = _live_pages(path)
        _replace_manifest(path, data, wanted)
    except (ValueError, TypeError) as error:
        reason = invalid(error, "", "").problem if isinstance(error, ValidationError) else error
        raise StudioError("bake.manifest_invalid", f"the manifest is invalid ({reason})", file=path) from None
    except OSError as error:
        problem = f"the manifest cannot be written ({error.strerror or error})"
        raise StudioError("bake.write_failed", problem, file=path) from None
    _remove_unused(directory, wanted | kept)
    return manifest


def _check_present(
    directory: Path, groups: Sequence[GroupEntry], audio: AudioEntry | None, behind: Sequence[Rendition]
) -> None:
    files: list[tuple[FileEntry, int | None]] = [(file, group.index) for group in groups for file in group.files]
    files += [(audio, None)] if audio is not None else []
    files += [(file, None) for part in behind for file in part.files]
    for wanted, group in files:
        file = directory / wanted.path
        size = file.stat().st_size if file.is_file() else None
        if size != wanted.bytes:
            problem = (
                f"{'the file is missing' if size is None else f'the file has {size} bytes'}; "
                f"expected {wanted.bytes} bytes"
            )
            fix = "Bake the stream again." if group is None else f"Bake group {group} again."
            raise StudioError(
                "bake.group_changed", problem, file=file, value=size, fix=fix, group=group, expected=wanted.bytes
            )


def _fitting(sizes: Sequence[int], start: int, limit: int) -> int:
    """End of the longest run from `start` whose sizes sum to `limit` at most; at least one item."""
    end, total = start, 0
    while end < len(sizes) and end - start < MAX_PAGE_GROUPS and (end == start or total + sizes[end] <= limit):
        total += sizes[end]
        end += 1
    return end


def _pages(directory: Path, groups: Sequence[GroupEntry], sizes: Sequence[int], start: int) -> tuple[PageEntry, ...]:
    pages = []
    while start < len(groups):
        end = _fitting(sizes, start, PAGE_BYTES)
        part = tuple(groups[start:end])
        data = Page(format=PAGE_FORMAT, groups=part).to_bytes()
        entry = entry_of(data, ".json")
        write_bytes(directory / entry.path, data)
        pages.append(PageEntry(**dict(entry), frames=tuple(group.frame_count for group in part)))
        start = end
    return tuple(pages)


def _renditions(groups: Sequence[GroupEntry], fps: float) -> tuple[RenditionEntry, ...]:
    entries = []
    for column in zip(*(group.renditions for group in groups), strict=True):
        measured = [(part.psnr_to_trained, part.frame_count) for part in column if part.psnr_to_trained is not None]
        frames = sum(count for _, count in measured)
        psnr = sum(psnr * count for psnr, count in measured) / frames if measured else None
        entries.append(
            RenditionEntry(
                id=column[0].id,
                qp=max(rendition.qp for rendition in column),
                splats=max(rendition.splats for rendition in column),
                sh_degree=column[0].sh_degree,
                pruning=column[0].pruning,
                psnr_to_trained=None if psnr is None else round(psnr, 3),
                bytes=sum(rendition.bytes for rendition in column),
                bandwidth=max(math.ceil(8 * rendition.bytes * fps / rendition.frame_count) for rendition in column),
            )
        )
    return tuple(entries)


def _replace_manifest(path: Path, data: bytes, files: Iterable[str]) -> None:
    """Write the manifest atomically once its files are on the disk: a power cut leaves the old stream or the new."""
    named = sorted({path.parent / name for name in files})
    for written in (*named, *sorted({written.parent for written in named} | {path.parent})):
        sync(written)
    write_bytes(path, data, durable=True)
    sync(path.parent)


def _live_pages(path: Path) -> set[str]:
    """Pages of the live manifest that is replaced: players that follow may need them until they read the new one."""
    try:
        old = parse_manifest(read_bounded(path, MAX_MANIFEST_BYTES), str(path))
        return {page.path for page in old.pages} if old.live else set()
    except (OSError, StudioError):
        return set()


def _remove_unused(directory: Path, used: set[str]) -> None:
    with contextlib.suppress(OSError):  # the stream is complete; what stays only takes room
        for file in (directory / FILES).iterdir():
            if f"{FILES}/{file.name}" not in used and file.is_file():
                file.unlink()
