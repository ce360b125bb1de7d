"""Files that are named by their content."""

import hashlib
import os
from pathlib import Path
from typing import Any

from studio.stream.manifest import FILES, NAME_DIGITS


def file_facts(data: bytes, suffix: str) -> dict[str, Any]:
    """The fields of a `FileEntry` with this content, which name it; `suffix` with its dot."""
    digest = hashlib.sha256(data).hexdigest()
    return {"path": f"{FILES}/{digest[:NAME_DIGITS]}{suffix}", "bytes": len(data), "sha256": digest}


def named_by_content(file: Path) -> dict[str, Any]:
    """Rename a file by its content, in its folder; its `file_facts`."""
    facts = file_facts(file.read_bytes(), file.suffix)
    os.replace(file, file.parent / Path(facts["path"]).name)
    return facts
