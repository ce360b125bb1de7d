"""Marks: bookmarked frames with notes, stored in the take."""

from __future__ import annotations

from pathlib import Path

from pipelines.takes.marks import read_marks, write_marks
from studio.errors import StudioError


class Marks:
    """The take's marks.

    Args:
        path: the file, which may not exist yet. None keeps marks in memory only (for a bare stream).

    Attributes:
        notes: notes by frame, counted from 0.
        error: message if the file is damaged, in which case it is never written; "" otherwise.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self.notes: dict[int, str] = {}
        self.error = ""
        self._damage: StudioError | None = None
        try:
            self.notes = read_marks(path) if path is not None else {}
        except StudioError as error:
            self._damage, self.error = error, str(error)

    @property
    def kept(self) -> bool:
        """Whether marks are saved to disk."""
        return self._path is not None

    def set(self, frame: int, note: str) -> None:
        """Mark a frame, or change its note.

        Raises:
            StudioError: the file is damaged or cannot be written.
        """
        self._write({**self.notes, frame: note.strip()})

    def remove(self, frame: int) -> None:
        """Remove a frame's mark.

        Raises:
            StudioError: the file is damaged or cannot be written.
        """
        self._write({other: note for other, note in self.notes.items() if other != frame})

    def next_after(self, frame: int, direction: int) -> int | None:
        """The nearest marked frame after (1) or before (-1) this one; None if there is none."""
        others = [other for other in self.notes if (other - frame) * direction > 0]
        return min(others, key=lambda other: abs(other - frame)) if others else None

    def _write(self, notes: dict[int, str]) -> None:
        if self._damage is not None:
            raise self._damage
        if self._path is not None:
            write_marks(self._path, notes)
        self.notes = notes
