"""Files that are named by their content."""

import hashlib
import os
from pathlib import Path
from typing import TypedDict

from studio.stream.manifest import hashed_path


class FileFacts(TypedDict):
    """The values of a `FileEntry`."""

    path: str
    bytes: int
    sha256: str


def content_name(data: bytes, suffix: str) -> tuple[str, str]:
    """Path and SHA-256 of a file with this content; `suffix` with its dot."""
    digest = hashlib.sha256(data).hexdigest()
    return hashed_path(digest, suffix), digest


def named_by_content(file: Path) -> FileFacts:
    """Rename a file by its content, in its folder. Returns its values for the manifest."""
    data = file.read_bytes()
    path, digest = content_name(data, file.suffix)
    os.replace(file, file.parent / Path(path).name)
    return {"path": path, "bytes": len(data), "sha256": digest}
