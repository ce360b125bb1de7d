"""Pointer files: small files in a mirror that stand for objects of a store, as Git LFS has them.

Whoever reads footage asks `cached_object` first; whoever does not finds a file that is no image and no video.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from studio.atomic_files import atomic_path
from studio.errors import show_as
from studio.storage.objects import CachedObject, Pointer, cache_full

_MAGIC = b"v3studio pointer 1\n"
_MOST_BYTES = 8192
_COPIED_AT_ONCE = 16 << 20


def pointer_bytes(pointer: Pointer) -> bytes:
    """Content of a pointer file."""
    return _MAGIC + json.dumps(asdict(pointer)).encode() + b"\n"


def read_pointer(path: Path) -> Pointer | None:
    """What a file stands for; None if it is an ordinary file, or missing."""
    try:
        if os.stat(path).st_size > _MOST_BYTES:
            return None
        with open(path, "rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                return None
            return Pointer(**json.loads(file.read()))
    except (OSError, ValueError, TypeError):
        return None


def cached_object(path: Path) -> CachedObject | None:
    """The object that a file stands for; None if it is an ordinary file.

    Raises:
        StudioError: `storage.*`.
    """
    pointer = read_pointer(path)
    return None if pointer is None else CachedObject(pointer)


def whole_file(path: Path) -> Path:
    """As `whole_files`, for a single file."""
    return whole_files([path])[0]


def whole_files(paths: Sequence[Path]) -> list[Path]:
    """Ordinary files with the contents of `paths`, for what only reads files.

    Objects of a store are copied to the machine's cache: together in one folder and with their names, because a model
    finds its external weights by name. Another version of an object has another folder. The copies are not counted as
    part of the cache. Other paths, also of missing files, are returned as they are.

    Args:
        paths: files of one folder.

    Raises:
        StudioError: `storage.*`.
    """
    pointers = {path: pointer for path in paths if (pointer := read_pointer(path)) is not None}
    if not pointers:
        return list(paths)
    first = next(iter(pointers.values()))
    key = hashlib.sha256("".join(f"{path.name}\0{found.key}\0" for path, found in pointers.items()).encode())
    folder = Path(first.cache) / "whole" / key.hexdigest()[:40]
    show_as(f"{folder}/", f"{first.store}/{first.path}"[: -len(first.path.rpartition("/")[2])])
    try:
        for path, pointer in pointers.items():
            _copy(pointer, folder / path.name)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise cache_full(Path(first.cache)) from None
    return [folder / path.name if path in pointers else path for path in paths]


def _copy(pointer: Pointer, path: Path) -> None:
    if path.is_file() and path.stat().st_size == pointer.size:
        return
    found = CachedObject(pointer)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        while part := found.read(_COPIED_AT_ONCE):
            file.write(part)
