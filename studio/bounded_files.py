"""Files from outside of the program, read up to a size: a file can be larger than memory and take no disk space."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import BinaryIO

from studio.bounded_text import BOUNDS

_PART = 1 << 20


def read_bounded(path: Path, limit: int = BOUNDS.size) -> bytes:
    """The whole file, if it has at most `limit` bytes.

    Raises:
        OSError: it cannot be read, is larger, or does not fit into memory; `strerror` is a clause that says so.
    """
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            data = b"" if size > limit else file.read(size + 1) if size else _read_unsized(file, limit + 1)
    except MemoryError:
        raise OSError(errno.ENOMEM, "it does not fit into memory", str(path)) from None
    if max(size, len(data)) > limit:
        raise OSError(errno.EFBIG, f"it has more than the {limit:,} bytes that are read", str(path))
    return data


def _read_unsized(file: BinaryIO, most: int) -> bytes:
    """What has no size, such as a pipe, or is empty. In parts: `read` allocates all that it is asked for at once."""
    parts: list[bytes] = []
    while most > 0 and (part := file.read(min(most, _PART))):
        parts.append(part)
        most -= len(part)
    return b"".join(parts)


def read_bounded_text(path: Path, encoding: str = "utf-8", limit: int = BOUNDS.size) -> str:
    """The same as text, with every line ending as a newline.

    Raises:
        OSError: as `read_bounded`.
        UnicodeDecodeError: another encoding.
    """
    return read_bounded(path, limit).decode(encoding).replace("\r\n", "\n").replace("\r", "\n")
