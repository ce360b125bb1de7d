"""Digests of values and of files."""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any


def digest_of(value: Any) -> str:
    """24 hex digits of the SHA-256 of a JSON-ready value; the order of keys does not matter."""
    text = json.dumps(value, sort_keys=True, ensure_ascii=False, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def digest_of_file(path: Path) -> str:
    """24 hex digits of the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:24]


def digests_of_files(folder: Path, files: Iterable[Path]) -> dict[str, str]:
    """`digest_of_file` by path relative to `folder`."""
    return {path.relative_to(folder).as_posix(): digest_of_file(path) for path in files}
