"""Files that are named by their content."""

import hashlib
import os
from pathlib import Path

from v3studio.studio.stream.manifest import FILES, NAME_DIGITS, FileEntry


def entry_of(data: bytes, suffix: str) -> FileEntry:
    """The entry of a file with this content, which names it; `suffix` with its dot."""
    digest = hashlib.sha256(data).hexdigest()
    return FileEntry(path=f"{FILES}/{digest[:NAME_DIGITS]}{suffix}", bytes=len(data), sha256=digest)


def named_by_content(file: Path) -> FileEntry:
    """Rename a file by its content, in its folder; its entry."""
    entry = entry_of(file.read_bytes(), file.suffix)
    os.replace(file, file.parent / Path(entry.path).name)
    return entry
