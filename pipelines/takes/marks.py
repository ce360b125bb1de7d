"""marks.json: frames marked for review, each with a note."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pipelines.takes.atomic_files import Result, disk_errors, read_model, write_model
from studio.errors import StudioError


class Mark(Result):
    """A marked frame."""

    frame: int
    """Counted from 0 in the take."""

    note: str


class Marks(Result):
    """Contents of marks.json."""

    marks: tuple[Mark, ...]


def read_marks(path: Path) -> dict[int, str]:
    """Notes by frame, counted from 0 in the take; empty if the file does not exist.

    Raises:
        StudioError: the file is not what `write_marks` writes (`take.marks_damaged`).
    """
    if not path.is_file():
        return {}
    try:
        return {mark.frame: mark.note for mark in read_model(path, Marks).marks}
    except StudioError as error:
        raise StudioError(
            "take.marks_damaged",
            f"marks cannot be read: {error.problem}",
            file=path,
            fix="Fix the file, or move it elsewhere to start over.",
        ) from None


def write_marks(path: Path, notes: Mapping[int, str]) -> None:
    """Write notes by frame, sorted by frame.

    Raises:
        StudioError: the file cannot be written (`take.disk_full`, `take.not_writable`).
    """
    with disk_errors(path.parent):
        write_model(path, Marks(marks=tuple(Mark(frame=frame, note=notes[frame]) for frame in sorted(notes))))
