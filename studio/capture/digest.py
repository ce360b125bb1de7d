"""Digest of a set of files."""

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path

from v3studio.studio.errors import StudioError
from v3studio.studio.storage.objects import read_pointer

HASH_WHOLE_BELOW = 512 << 20  # total size in bytes up to which file contents are hashed; see `digest_files`


def digest_files(root: Path, paths: Iterable[Path], names: Mapping[Path, str] | None = None) -> str:
    """SHA-256 (64 hexadecimal digits) of files by name, size and contents.

    If the total size of the files exceeds `HASH_WHOLE_BELOW`, modification times are used instead of contents. Below
    that, a copy of a capture has the same digest. Of objects in a store, the version that the store tells (its ETag) is
    used: they are not read. File names are relative to `root`; `names` has those of files that are neither below it nor
    always at the same path.
    """
    digest = hashlib.sha256()
    other_names = names or {}
    # named ones last, as their place among the others depends on their path
    unique = sorted(set(paths), key=lambda path: (path in other_names, other_names.get(path, ""), path))
    try:
        states = [path.stat() for path in unique]
        read = sum(state.st_size for state in states) <= HASH_WHOLE_BELOW
        for path, state in zip(unique, states, strict=True):
            name = Path(other_names.get(path, path.relative_to(root) if path.is_relative_to(root) else path))
            stored = read_pointer(path)
            if stored is not None:
                digest.update(f"{name.as_posix()}\0{stored.size}\0{stored.tag}".encode())
                continue
            digest.update(f"{name.as_posix()}\0{state.st_size}\0".encode())
            if read:
                with path.open("rb") as file:
                    digest.update(hashlib.file_digest(file, "sha256").digest())
            else:
                digest.update(str(state.st_mtime_ns).encode())
    except OSError as error:
        problem = f"cannot read the file ({error.strerror})"
        raise StudioError("footage.file_unreadable", problem, file=error.filename) from None
    return digest.hexdigest()
