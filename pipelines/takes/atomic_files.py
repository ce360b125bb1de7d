"""Files written whole or not at all, digests, and the disk-full sentence."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipelines.config.renamed import first_path
from studio.errors import StudioError

PARTIAL = ".partial"
"""Ending of temporary names; whatever carries it is left over from a killed run and counts for nothing."""


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary path in the same folder, moved to `path` when the block ends well, deleted when it does not.

    The temporary name keeps the file's ending, which some writers choose the format by.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{PARTIAL}{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException:
        remove(temporary)
        raise


def write_text(path: Path, text: str) -> None:
    """Atomic, UTF-8."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    """Atomic, readable, with a final newline; NaN is refused (it is not JSON)."""
    write_text(path, json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """What `write_json` wrote.

    Raises:
        StudioError: not there, not readable or not JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise StudioError(f"{path}: there is no such file.") from None
    except (OSError, ValueError) as error:
        raise StudioError(f"{path}: cannot be read ({error}); delete it and run again.") from None


def remove(path: Path) -> None:
    """Delete a file or a folder, if there is one."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def sweep_partial(folder: Path) -> int:
    """Delete what killed runs left half-written under `folder`; returns how many files and folders."""
    left_over = [path for path in folder.rglob(f".*{PARTIAL}*") if path.name.startswith(".")]
    for path in left_over:
        remove(path)
    return len(left_over)


def digest_of(value: Any) -> str:
    """A short digest of a JSON-ready value, independent of the order of keys."""
    text = json.dumps(value, sort_keys=True, ensure_ascii=False, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def digest_of_file(path: Path) -> str:
    """A short digest of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:24]


def digest_of_files(folder: Path, files: Iterable[Path]) -> str:
    """A short digest of files' names (relative to `folder`, as they were called first) and bytes."""
    return digest_of({first_path(path.relative_to(folder).as_posix()): digest_of_file(path) for path in files})


def link_or_copy(source: str, target: str) -> None:
    """A hard link where the file system allows it, else a copy."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


@contextmanager
def disk_errors(folder: Path) -> Iterator[None]:
    """Turns "no space left" and "not allowed" into sentences that name the folder.

    Raises:
        StudioError: the disk is full, a quota is used up, or the folder is not writable.
    """
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise StudioError(
                f"The disk of {folder} is full; make room and run again: what is finished is kept."
            ) from error
        if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            name = error.filename or folder
            raise StudioError(f"{name} may not be written to ({error.strerror}); choose another folder.") from error
        raise
