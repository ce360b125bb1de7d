"""marks.json: frames of a take that somebody wants to come back to, each with a note."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pipelines.takes.atomic_files import disk_errors, read_json, write_json
from studio.errors import StudioError


def read_marks(path: Path) -> dict[int, str]:
    """Frame, counted from 0 in the take, to note; empty where there is no such file.

    Raises:
        StudioError: the file holds something else.
    """
    if not path.is_file():
        return {}
    try:
        return {int(mark["frame"]): str(mark["note"]) for mark in read_json(path)["marks"]}
    except (KeyError, TypeError, ValueError):
        raise StudioError(f"{path}: holds no marks that can be read; mend it, or move it away to begin anew.") from None


def write_marks(path: Path, notes: Mapping[int, str]) -> None:
    """Write them, in the order of the frames.

    Raises:
        StudioError: the file cannot be written.
    """
    with disk_errors(path.parent):
        write_json(path, {"marks": [{"frame": frame, "note": notes[frame]} for frame in sorted(notes)]})
