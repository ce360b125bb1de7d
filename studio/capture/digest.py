"""A short name for the contents of many files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from studio.errors import StudioError

HASH_WHOLE_BELOW = 512 << 20


def digest_files(root: Path, paths: Iterable[Path]) -> str:
    """Digest of files by name (relative to `root` where below it), size and contents.

    Contents are read where all files together are below 512 MiB, so a copied capture keeps its digest. Above that the
    modification times stand for the contents.

    Returns:
        64 hexadecimal digits.

    Raises:
        StudioError: a file cannot be read.
    """
    whole = hashlib.sha256()
    unique = sorted(set(paths))
    try:
        states = [path.stat() for path in unique]
        read = sum(state.st_size for state in states) <= HASH_WHOLE_BELOW
        for path, state in zip(unique, states, strict=True):
            name = path.relative_to(root) if path.is_relative_to(root) else path
            whole.update(f"{name.as_posix()}\0{state.st_size}\0".encode())
            if read:
                with path.open("rb") as file:
                    whole.update(hashlib.file_digest(file, "sha256").digest())
            else:
                whole.update(str(state.st_mtime_ns).encode())
    except OSError as error:
        raise StudioError(f"The file {error.filename} cannot be read ({error.strerror}).") from None
    return whole.hexdigest()
