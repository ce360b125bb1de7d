"""Manifest values of a written file."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any


def describe(file: Path, folder: str) -> dict[str, Any]:
    """Path (as `folder`/name), size and SHA-256 of a file, as `FileEntry` takes them."""
    data = file.read_bytes()
    return {"path": f"{folder}/{file.name}", "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
