"""Checks of paths specified by the user."""

from __future__ import annotations

from pathlib import Path

from studio.errors import StudioError


def need_utf8(path: Path) -> None:
    """Check that a path can be passed to every library and written to a settings file.

    Raises:
        StudioError: it is not valid UTF-8 (path.not_utf8).
    """
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        shown = str(path).encode("utf-8", "backslashreplace").decode()
        raise StudioError(
            "path.not_utf8", "the path is not valid UTF-8", file=shown, fix="Rename the folder."
        ) from None
