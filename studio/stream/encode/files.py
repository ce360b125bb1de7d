"""Files that are named by their content."""

import hashlib
import os
from pathlib import Path

from studio.stream.manifest import FILES, NAME_DIGITS, FileEntry


def content_name(data: bytes, suffix: str) -> tuple[str, str]:
    """Path and SHA-256 of a file with this content; `suffix` with its dot."""
    digest = hashlib.sha256(data).hexdigest()
    return f"{FILES}/{digest[:NAME_DIGITS]}{suffix}", digest


def named_by_content(file: Path) -> FileEntry:
    """Rename a file by its content, in its folder. Returns its entry."""
    data = file.read_bytes()
    path, digest = content_name(data, file.suffix)
    os.replace(file, file.parent / Path(path).name)
    return FileEntry(path=path, bytes=len(data), sha256=digest)
