"""marks.json: frames marked for review, each with a note.

The window and browsers (`v3studio serve --review`) change the same file. A change concerns one frame, is made under a
lock, and says what it replaces, so that neither loses what the other wrote.
"""

from __future__ import annotations

import unicodedata
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError, model_validator

from v3studio.pipelines.takes.files.json_files import Result, read_json, validated, write_model
from v3studio.pipelines.takes.files.locks import changing
from v3studio.studio.errors import StudioError, plain_text

MAX_NOTE, MAX_AUTHOR = 2000, 80  # longest note and name, in characters
MAX_MARKS = 2000  # most marks of a take
MAX_POSITION = 1e9  # largest magnitude of a coordinate, as in streams
MAX_FILE_BYTES = 32_000_000  # larger files are refused; `MAX_MARKS` notes of `MAX_NOTE` characters take less

Coordinate = Annotated[float, Field(ge=-MAX_POSITION, le=MAX_POSITION)]
Point = tuple[Coordinate, Coordinate, Coordinate]


class MarkView(Result):
    """The view of a frame when it was marked, and what was compared. World coordinates of the take."""

    eye: Point  # position of the viewer
    target: Point  # the point looked at, not that of the viewer
    fov: float = Field(gt=0, lt=180)  # vertical field of view of that window, degrees
    camera: str = Field(default="", max_length=200)  # the capture camera that was looked through; "" for a free view

    wipe: float | None = Field(default=None, ge=0, le=1)
    """Position of the line between footage (left) and splats; None: they were not compared."""

    whole: bool = False  # whether the whole image of `camera` was shown, not only the performer
    place: Point | None = None  # the point that the note is about; None: the whole image

    @model_validator(mode="after")
    def _has_direction(self) -> MarkView:
        if self.eye == self.target:
            raise ValueError("eye and target must differ")
        return self


class Mark(Result):
    """A marked frame."""

    frame: int = Field(ge=0, strict=True)
    """Frame number in the footage (`pipelines.takes.frames.frame_numbers`); what browsers exchange is counted from 0 in
    the stream."""

    note: str
    author: str = ""  # who wrote the note, as they gave their name in the browser; "" for marks of the window
    view: MarkView | None = None  # None: not known

    @property
    def words(self) -> str:
        """The note, with its author where there is one."""
        return f"{self.note} ({self.author})" if self.author else self.note


class Marks(Result):
    """Contents of marks.json."""

    marks: tuple[Mark, ...]


def read_marks(path: Path) -> dict[int, Mark]:
    """Marks by frame number; empty without the file. Raises StudioError: `take.marks_damaged`."""
    return {mark.frame: mark for mark in _read(path).marks}


def change_mark(path: Path, frame: int, mark: Mark | None, replaces: Mark | None) -> dict[int, Mark]:
    """Add, change or remove (`mark` None) the mark of one frame; returns all marks by frame. Others stay as they are in
    the file. Note and author are made plain (`plain_note`). `replaces`: the frame's mark when the change was begun;
    None for none.

    A change that has been made already, which a sender who got no answer repeats, changes nothing. StudioError if the
    mark is another one by now (`take.mark_changed`), too long (`take.mark_too_long`), of a view too far away
    (`take.mark_too_far`), one too many (`take.too_many_marks`), or the file is damaged (as `read_marks`) or cannot be
    written (`take.disk_full`, `take.not_writable`).
    """
    if mark is not None:
        mark = _plain(path, mark)
    with changing(path):
        file = _read(path)
        marks = {marked.frame: marked for marked in file.marks}
        if marks.get(frame) == mark:
            return marks
        if _content(marks.get(frame)) != _content(replaces):
            problem = f"the mark of frame {frame} was changed in the meantime"
            fix = "Look at it, then change it again."
            raise StudioError("take.mark_changed", problem, file=path, value=frame, fix=fix)
        if mark is None:
            marks.pop(frame, None)
        elif frame not in marks and len(marks) >= MAX_MARKS:
            problem = f"there are {len(marks)} marks already"
            raise StudioError("take.too_many_marks", problem, file=path, fix="Remove some.")
        else:
            marks[frame] = mark
        write_model(path, file.model_copy(update={"marks": tuple(marks[at] for at in sorted(marks))}), durable=True)
    return marks


def plain_note(text: str) -> str:
    """`plain_text`, without characters that no font has."""
    return "".join(sign for sign in plain_text(text) if unicodedata.category(sign) not in ("Cs", "Co", "Cn")).strip()


def _plain(path: Path, mark: Mark) -> Mark:
    note, author = plain_note(mark.note), plain_note(mark.author)
    for text, most, what in ((note, MAX_NOTE, "note"), (author, MAX_AUTHOR, "name")):
        if len(text) > most:
            problem = f"the {what} has {len(text)} characters, at most {most} are kept"
            raise StudioError("take.mark_too_long", problem, file=path, fix="Shorten it.")
    fields: dict[str, object] = {"frame": mark.frame, "note": note} | ({"author": author} if author else {})
    if mark.view is not None:
        # of what a browser has sent, only what is known
        view = mark.view.model_dump(include=set(MarkView.model_fields))
        try:
            fields["view"] = MarkView.model_validate({**view, "camera": plain_note(mark.view.camera)})
        except ValidationError:
            problem = f"the view of frame {mark.frame} is too far away"
            raise StudioError("take.mark_too_far", problem, file=path, fix="Move closer.") from None
    return Mark.model_validate(fields)


def _content(mark: Mark | None) -> tuple[str, str] | None:
    return None if mark is None else (mark.note, mark.author)


def _read(path: Path) -> Marks:
    if not path.is_file():
        return Marks(marks=())
    try:
        return validated(path, read_json(path, MAX_FILE_BYTES), Marks)
    except StudioError as error:
        fix = "Fix the file, or move it elsewhere to start over."
        raise StudioError("take.marks_damaged", f"marks cannot be read: {error.problem}", file=path, fix=fix) from None
