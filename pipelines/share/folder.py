"""A folder for any web server: the player, the stream, a poster; nothing is loaded from elsewhere."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipelines.share.beside import PAGE_NAME, page_files
from pipelines.share.player_files import read_player
from pipelines.share.results import PageText, Shared
from pipelines.share.stream_files import stream_to_share
from pipelines.takes.atomic_files import disk_errors, remove
from pipelines.version import program_version
from studio.atomic_files import leftovers, remove_leftovers, temporary_path
from studio.bounded_text import parse_json
from studio.errors import StudioError
from studio.progress import ProgressFn, no_progress
from studio.stream.manifest import MANIFEST_NAME

RECORD_NAME = "share.json"
"""Lists what a share consists of, so that it can be replaced, and nothing else."""

RECORD_FORMAT, RECORD_VERSION = "v3studio-share", 1


def share_folder(source: str, out: Path, text: PageText | None = None, progress: ProgressFn = no_progress) -> Shared:
    """Write a self-contained folder: index.html, the player, the poster, the stream below `stream/`, and a record.

    All names in it are relative, so that it works below any path of any web server. An earlier share in `out` is
    replaced when the new one is complete.

    Args:
        source: folder of a take or a stream, or a URL.
        out: folder to write; must not exist, be empty, or be an earlier share.
        text: of the page; what is None is taken from the stream.
        progress: files done and in total.

    Raises:
        StudioError: `share.out_exists`, `share.no_player`, no stream in `source`, a damaged stream, or a disk that is
            full or not writable.
    """
    player = read_player()
    out = out.expanduser().absolute()
    _check_replaceable(out)
    with stream_to_share(source) as stream, disk_errors(out), _replaced(out) as folder:
        files = stream.files
        total = len(files) + 1
        words = stream.text(text or PageText())
        written: dict[str, int] = {}

        def write(name: str, data: bytes) -> None:
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
            written[name] = len(data)

        progress(0, total)
        beside = page_files(stream, words, player, f"stream/{MANIFEST_NAME}")
        for done, file in enumerate(files, start=1):
            progress(done, total)
            write(f"stream/{file.path}", stream.read(file))
        write(f"stream/{MANIFEST_NAME}", stream.manifest_bytes)
        for name, data in beside.items():
            write(name, data)
        stream_bytes = sum(size for name, size in written.items() if name.startswith("stream/"))
        record = {
            "format": RECORD_FORMAT,
            "version": RECORD_VERSION,
            "program": f"v3studio {program_version()}",
            "title": words.title,
            "files": [{"path": name, "bytes": size} for name, size in sorted(written.items())],
        }
        write(RECORD_NAME, (json.dumps(record, indent=1, ensure_ascii=False) + "\n").encode())
        progress(total, total)
    return Shared(
        form="folder",
        path=out,
        title=words.title or "",
        files=len(written),
        total_bytes=sum(written.values()),
        stream_bytes=stream_bytes,
        player_bytes=written[PAGE_NAME] + sum(len(data) for data in player.hashed.values()),
        poster_bytes=len(next(iter(beside.values()))),
    )


def _check_replaceable(out: Path) -> None:
    """Raises StudioError (`share.out_exists`) unless `out` is missing, empty, or an earlier share and nothing else."""
    if not os.path.lexists(out):
        return
    fix = "Choose another folder, or delete it."
    if not out.is_dir() or out.is_symlink():
        raise StudioError("share.out_exists", "exists and is not a folder", file=out, fix=fix)
    present = {path.relative_to(out).as_posix() for path in out.rglob("*") if not path.is_dir() or path.is_symlink()}
    if not present and not any(out.iterdir()):
        return
    listed = _recorded(out / RECORD_NAME)
    if listed is None:
        raise StudioError("share.out_exists", "exists and is not an earlier share", file=out, fix=fix)
    strange = sorted(present - listed - {RECORD_NAME})
    if strange:
        raise StudioError(
            "share.out_exists",
            f"is an earlier share, but holds files that are not part of it, {strange[0]} first",
            file=out,
            value=strange[0],
            fix="Move them away, or choose another folder.",
        )


def _recorded(path: Path) -> set[str] | None:
    """Files that a share's record lists; None if it is not one."""
    try:
        record = parse_json(path.read_bytes())
        if record["format"] != RECORD_FORMAT:
            return None
        return {str(file["path"]) for file in record["files"]}
    except (OSError, ValueError, KeyError, TypeError):
        return None


@contextmanager
def _replaced(out: Path) -> Iterator[Path]:
    """A temporary folder beside `out` that takes its place when the block succeeds, and is deleted otherwise."""
    new, old = temporary_path(out), temporary_path(out, ".old")
    for path in leftovers(out.parent, out, ".old"):
        if os.path.lexists(out):
            remove(path)
        else:  # killed between the renames: it is the earlier share
            os.rename(path, out)
    remove_leftovers(out.parent, out)
    remove(new)
    new.mkdir(parents=True)
    try:
        yield new
        _check_replaceable(out)  # it took a while: somebody may have written there meanwhile
        if os.path.lexists(out):
            os.rename(out, old)
        try:
            os.rename(new, out)
        except OSError:
            if old.exists():
                os.rename(old, out)
            raise
    finally:
        remove(new)
    remove(old)
