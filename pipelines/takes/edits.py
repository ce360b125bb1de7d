"""edits.json: the edits of a take, with those before each change, for undo.

The window and `v3studio edit` change the same file. A change is made under a lock and says what it replaces, so that
neither loses what the other wrote.
"""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from pipelines.takes.atomic_files import disk_errors, read_json, validated, write_json
from studio.edits.edit_list import EditList
from studio.errors import StudioError

EDITS_FORMAT = 1
"""Version of edits.json."""

MOST_STEPS = 50
"""Changes that can be undone."""

MAX_FILE_BYTES = 16_000_000
"""Larger files are refused; the oldest changes are forgotten before a file gets this large."""

_KEPT_BYTES = 4_000_000
_SHOW = "See the edits that there are with `v3studio edit list TAKE`."


class Step(BaseModel):
    """A change: what it was, and the edits on its other side."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    words: str = Field(max_length=200)
    """What was changed: "trim to frames 3 to 20"."""

    edits: EditList
    """Before the change, of those to undo; after it, of those to redo."""


class EditsFile(BaseModel):
    """Contents of edits.json."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: int = EDITS_FORMAT
    edits: EditList = EditList()
    undo: tuple[Step, ...] = Field(default=(), max_length=MOST_STEPS)
    redo: tuple[Step, ...] = Field(default=(), max_length=MOST_STEPS)


def read_edits(path: Path) -> EditList:
    """The edits of a take; empty if the file does not exist.

    Raises:
        StudioError: the file is not what this module writes (`take.edits_damaged`), or of a later version
            (`take.edits_unknown_format`).
    """
    return read_edits_file(path).edits


def read_edits_file(path: Path) -> EditsFile:
    """The edits and their history; see `read_edits`."""
    if not path.exists():
        return EditsFile()
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise StudioError("take.damaged", f"has more than {MAX_FILE_BYTES} bytes")
        found: Any = read_json(path)
        if isinstance(found, dict) and found.get("format") != EDITS_FORMAT:
            raise StudioError(
                "take.edits_unknown_format",
                f"edits of format {found.get('format')!r}; this version reads format {EDITS_FORMAT}",
                file=path,
                value=found.get("format"),
                fix="Use the version that wrote it.",
            )
        return validated(path, found, EditsFile)
    except StudioError as error:
        if error.code == "take.edits_unknown_format":
            raise
        raise StudioError(
            "take.edits_damaged",
            f"the edits are damaged: {error.problem}",
            file=path,
            fix="Fix the file, or move it elsewhere to start over.",
        ) from None


def change_edits(path: Path, edits: EditList, words: str, replaces: EditList | None = None) -> EditsFile:
    """Replace the edits of a take by others; the change can be undone.

    Args:
        path: edits.json, which may not exist yet.
        edits: the new ones. If they equal the present ones, nothing is written.
        words: what is changed, at most 200 characters.
        replaces: the edits as they were when the change was begun; None: whatever they are.

    Raises:
        StudioError: the edits are others by now (`take.edits_changed`), or the file is damaged (as `read_edits`) or
            cannot be written (`take.disk_full`, `take.not_writable`).
    """
    with _changing(path):
        found = read_edits_file(path)
        if replaces is not None and found.edits != replaces:
            raise StudioError(
                "take.edits_changed",
                "the edits were changed in the meantime",
                file=path,
                fix="Look at them, then make the change again.",
            )
        if found.edits == edits:
            return found
        step = Step(words=words[:200], edits=found.edits)
        return _write(path, EditsFile(edits=edits, undo=(*found.undo, step)[-MOST_STEPS:]))


def undo_edit(path: Path) -> tuple[EditsFile, str]:
    """Take the last change back.

    Returns:
        the file, and what was undone.

    Raises:
        StudioError: there is none (`take.nothing_to_undo`), or as `change_edits`.
    """
    with _changing(path):
        found = read_edits_file(path)
        if not found.undo:
            raise StudioError("take.nothing_to_undo", "there is no edit to undo", file=path, fix=_SHOW)
        step = found.undo[-1]
        redo = (*found.redo, Step(words=step.words, edits=found.edits))[-MOST_STEPS:]
        return _write(path, EditsFile(edits=step.edits, undo=found.undo[:-1], redo=redo)), step.words


def redo_edit(path: Path) -> tuple[EditsFile, str]:
    """Make the change that was undone last again; see `undo_edit`.

    Raises:
        StudioError: there is none (`take.nothing_to_redo`), or as `change_edits`.
    """
    with _changing(path):
        found = read_edits_file(path)
        if not found.redo:
            raise StudioError("take.nothing_to_redo", "there is no edit to redo", file=path, fix=_SHOW)
        step = found.redo[-1]
        undo = (*found.undo, Step(words=step.words, edits=found.edits))[-MOST_STEPS:]
        return _write(path, EditsFile(edits=step.edits, undo=undo, redo=found.redo[:-1])), step.words


def _write(path: Path, file: EditsFile) -> EditsFile:
    """Write the file, without the oldest changes if they are too large."""
    undo = list(file.undo)
    size = sum(len(step.model_dump_json()) for step in undo)
    while len(undo) > 1 and size > _KEPT_BYTES:
        size -= len(undo.pop(0).model_dump_json())
    file = file.model_copy(update={"undo": tuple(undo)})
    write_json(path, file.model_dump(mode="json", exclude_defaults=True) | {"format": file.format}, durable=True)
    return file


@contextmanager
def _changing(path: Path) -> Iterator[None]:
    """Changes by all processes, one after the other. The kernel releases the lock of a killed process."""
    private = path.parent / ".v3studio"
    with disk_errors(path.parent):
        private.mkdir(parents=True, exist_ok=True)
        with (private / "edits.lock").open("a") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield
