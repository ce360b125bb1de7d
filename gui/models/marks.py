"""Marks: bookmarked frames with notes, stored in the take."""

from pathlib import Path

from v3studio.pipelines.takes.authored.marks import Mark, MarkView, change_mark, read_marks
from v3studio.studio.errors import StudioError


class Marks:
    """The take's marks by frame number in the footage (`FrameNumbers`). Others may change the file, too, such as
    browsers (`v3studio serve --review`); it may not exist yet, and None keeps marks in memory only (for a bare stream).
    `damage`: why the file cannot be read, in which case it is never written; None if it can."""

    def __init__(self, path: Path | None = None) -> None:
        self.open(path)

    def open(self, path: Path | None) -> None:
        """Read the marks of another take; None for a stream."""
        self._path = path
        self._seen: object = None
        self.marks: dict[int, Mark] = {}
        self.damage: StudioError | None = None
        self.refresh()

    @property
    def kept(self) -> bool:
        return self._path is not None

    @property
    def notes(self) -> dict[int, str]:
        """Notes by frame number, with their authors where known."""
        return {frame: mark.words for frame, mark in self.marks.items()}

    def refresh(self) -> bool:
        """Read the file if it has changed; returns whether it has."""
        if self._path is None:
            return False
        stamp = None
        if self._path.is_file():
            about = self._path.stat()
            stamp = (about.st_mtime_ns, about.st_ino, about.st_size)
        if stamp == self._seen:
            return False
        self._seen, self.damage = stamp, None
        try:
            self.marks = read_marks(self._path)
        except StudioError as error:
            self.marks, self.damage = {}, error
        return True

    def set(self, frame: int, note: str, replaces: Mark | None, view: MarkView | None = None) -> bool:
        """Mark a frame, or change its note; returns whether there was anything to change. `replaces`: its mark when the
        change was begun; `view`: what is on screen; a mark that has a view keeps its own. StudioError if somebody else
        has changed this mark meanwhile, or the file is damaged or cannot be written."""
        note = note.strip()
        if replaces is not None and note == replaces.note:
            return False
        view = replaces.view or view if replaces is not None else view
        mark = Mark(frame=frame, note=note) if view is None else Mark(frame=frame, note=note, view=view)
        self.put(frame, mark, replaces)
        return True

    def next_after(self, frame: int, direction: int) -> int | None:
        """The nearest marked frame after (1) or before (-1) this one; None if there is none."""
        others = [other for other in self.marks if (other - frame) * direction > 0]
        return min(others, key=lambda other: abs(other - frame)) if others else None

    def put(self, frame: int, mark: Mark | None, replaces: Mark | None) -> None:
        """Set a frame's mark, or remove it (None); `replaces` and exceptions as `set`."""
        if self.damage is not None:
            raise self.damage
        if self._path is not None:
            self.marks = change_mark(self._path, frame, mark, replaces)
        elif mark is None:
            self.marks = {other: kept for other, kept in self.marks.items() if other != frame}
        else:
            self.marks = {**self.marks, frame: mark}
