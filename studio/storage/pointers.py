"""Pointer files: small files in a mirror that stand for objects of a store, as Git LFS has them.

Whoever reads footage asks `cached_object` first; whoever does not finds a file that is no image and no video.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path

from studio.atomic_files import atomic_path
from studio.storage.objects import CachedObject, Pointer

_MAGIC = b"v3studio pointer 1\n"
_MOST_BYTES = 8192


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
    """An ordinary file with the content of `path`, for what only reads files; `path` itself if it is one.

    The content replaces the pointer file and is not counted as part of the cache.

    Raises:
        StudioError: `storage.*`.
    """
    found = cached_object(path)
    if found is not None:
        with atomic_path(path) as temporary:
            temporary.write_bytes(found.read())
    return path
