"""Paths that a user gives."""

from __future__ import annotations

from pathlib import Path

from studio.errors import StudioError


def need_utf8(path: Path) -> None:
    """A path must be text that every library and every file of settings can hold.

    Raises:
        StudioError: its bytes are not UTF-8.
    """
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        shown = str(path).encode("utf-8", "backslashreplace").decode()
        raise StudioError(f"{shown}: the path is not valid UTF-8; rename the folder.") from None
