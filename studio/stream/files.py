"""Manifest values of a written file."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TypedDict


class FileFacts(TypedDict):
    """The values of a `FileEntry`."""

    path: str
    bytes: int
    sha256: str


def describe(file: Path, folder: str) -> FileFacts:
    """Path (as `folder`/name), size and SHA-256 of a file."""
    data = file.read_bytes()
    return {"path": f"{folder}/{file.name}", "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
