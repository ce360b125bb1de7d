"""Bakes that are kept under a name: `bakes/NAME/` beside the take's stream.

Each holds the stream as it was baked, and what makes it the take's stream again: the record of the stage, notes on its
groups, and the evaluation if there was one. Files are hard links to those of the stream where the file system has them,
so that keeping costs no space until the stream is baked anew. Nothing in a take is changed in place, so links stay as
they were.
"""

from __future__ import annotations

import contextlib
import datetime
import os
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, JsonValue, field_validator

from pipelines.takes.atomic_files import (
    Result,
    digest_of_file,
    digest_of_files,
    link_or_copy,
    read_model,
    remove,
    write_model,
)
from pipelines.takes.edit_params import PREFIX, edit_params
from pipelines.takes.edits import read_edits
from pipelines.takes.evaluation import read_evaluation
from pipelines.takes.records import StageRecord, current_record, read_record, result_of
from pipelines.takes.take import Take
from studio.atomic_files import PARTIAL, atomic_path, sync, temporary_path
from studio.errors import StudioError
from studio.json_types import JsonData

NOTE = "bake.json"
"""Written last: a folder without it is not a kept bake."""

Problem = Literal["changed", "missing"]

_NAME = re.compile(r"[^\W_][\w .-]{0,59}")
_DEVICE = re.compile(r"(con|prn|aux|nul|(com|lpt)[0-9¹²³]) *(\..*)?", re.IGNORECASE)
"""Names that Windows keeps for devices, with any ending."""


class KeptBakeNote(Result):
    """bakes/NAME/bake.json."""

    kept: str = ""
    """When, UTC, ISO 8601."""

    bake: StageRecord
    """Record of the stage `bake`; paths are relative to the take, as when it was the take's stream."""

    evaluate: StageRecord | None = None
    """Record of `evaluate` for this stream; None if it was not measured."""

    notes: tuple[str, ...] = Field(default=())
    """Names of the files in notes/: what each baked group was made from."""

    @field_validator("bake", "evaluate", mode="before")
    @classmethod
    def _current_names(cls, record: Any) -> Any:
        return current_record(record) if isinstance(record, dict) else record

    @field_validator("notes")
    @classmethod
    def _names_of_files(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if not all(re.fullmatch(r"group_\d+\.json", name) for name in names):
            raise ValueError("a name is not that of a note")
        return names


@dataclass(frozen=True)
class KeptBake:
    """A kept bake.

    Attributes:
        name: as the user named it.
        folder: bakes/NAME in the take.
        note: what is recorded of it.
        bytes: size of the stream.
        frees: bytes that are free again after it is removed: of files that nothing else in the take shares.
        chosen: whether it is the take's stream now.
        current: whether it was baked from the take's present training.
        same_edits: whether it was baked with the take's present edits; False also if those cannot be read.
    """

    name: str
    folder: Path
    note: KeptBakeNote
    bytes: int
    frees: int
    chosen: bool
    current: bool
    same_edits: bool

    @property
    def stream(self) -> Path:
        """Folder of the stream."""
        return self.folder / "stream"

    @property
    def evaluation(self) -> Path:
        """evaluation.json; there is none if it was not measured."""
        return self.folder / "evaluation.json"

    @property
    def bytes_per_frame(self) -> float:
        """Of the stream's best rendition; 0 if its record does not tell."""
        return _number(self.note.bake.summary.get("bytes_per_frame")) or 0.0

    @property
    def psnr(self) -> float | None:
        """Mean PSNR of its decoded frames, dB, from its evaluation; None if it was not measured."""
        if self.note.evaluate is None or not self.evaluation.is_file():
            return None
        try:
            return read_evaluation(self.evaluation).summary.psnr_decoded
        except StudioError:  # damaged; `v3studio check` tells
            return None

    @property
    def qp(self) -> int | None:
        """`bake.qp` that it was made with."""
        value = _number(self.note.bake.params.get("bake.qp"))
        return None if value is None else int(value)

    @property
    def settings(self) -> dict[str, JsonValue]:
        """Settings of `bake` that it was made with, by dotted name."""
        return {name: value for name, value in self.note.bake.params.items() if name.startswith("bake.")}


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None


def kept_bakes(take: Take) -> list[KeptBake]:
    """The kept bakes of a take, oldest first; folders that are not one, or whose note is damaged, are left out."""
    folder = take.bakes
    edits = _present_edits(take)
    found = []
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if _NAME.fullmatch(path.name) and (path / NOTE).is_file():
            with contextlib.suppress(StudioError):
                found.append(_kept(take, path, edits))
    return sorted(found, key=lambda kept: (kept.note.kept, kept.name))


def kept_bake(take: Take, name: str) -> KeptBake:
    """The kept bake of a name.

    Raises:
        StudioError: there is none (`bakes.not_found`), the name cannot be one (`bakes.invalid_name`), or its note is
            damaged (`take.damaged`).
    """
    name = check_name(name)
    path = take.bakes / name
    if not (path / NOTE).is_file():
        known = ", ".join(kept.name for kept in kept_bakes(take))
        raise StudioError(
            "bakes.not_found",
            f"no bake is kept as '{name}'",
            file=take.root,
            value=name,
            fix=f"There are: {known}." if known else "Keep the present one with `v3studio bakes keep`.",
        )
    return _kept(take, path, _present_edits(take))


def _present_edits(take: Take) -> dict[str, JsonData] | None:
    """The take's edits as parameters of a bake; None if they cannot be read, which commands that need them tell."""
    try:
        return edit_params(read_edits(take.edits))
    except StudioError:
        return None


def _kept(take: Take, path: Path, edits: dict[str, JsonData] | None) -> KeptBake:
    note = read_model(path / NOTE, KeptBakeNote)
    sizes = list(_states(path / "stream"))
    return KeptBake(
        name=path.name,
        folder=path,
        note=note,
        bytes=sum(state.st_size for state in sizes),
        frees=sum(state.st_size for state in _states(path) if state.st_nlink == 1),
        chosen=result_of(take, "bake") == note.bake.result,
        current=note.bake.params.get("result of train") == result_of(take, "train"),
        same_edits={name: value for name, value in note.bake.params.items() if name.startswith(PREFIX)} == edits,
    )


def _states(folder: Path) -> Iterator[os.stat_result]:
    for path in folder.rglob("*"):
        if path.is_file():
            yield path.stat()


def check_name(name: str) -> str:
    """Check a name of a kept bake; returns it as the folder is named: accented letters in composed form (NFC).

    Raises:
        StudioError: no bake can have it (`bakes.invalid_name`).
    """
    name = unicodedata.normalize("NFC", name)
    if not _NAME.fullmatch(name) or name[-1] in " ." or len(name.encode()) > 120:
        raise _invalid(name, "Use up to 60 letters, digits, spaces and . - _, beginning with a letter or a digit.")
    return name


def _invalid(name: str, fix: str) -> StudioError:
    return StudioError("bakes.invalid_name", f"'{name}' cannot be the name of a bake", value=name, fix=fix)


def refuse_taken(take: Take, name: str) -> str:
    """Check, before a long run, that a bake can be kept under a name; returns it as `check_name`.

    Raises:
        StudioError: it cannot be the name of a folder on every system, or is one of temporary files
            (`bakes.invalid_name`), or another bake has it (`bakes.name_taken`).
    """
    name = check_name(name)
    if PARTIAL in name:
        raise _invalid(name, f"Leave out '{PARTIAL}', which marks temporary files.")
    if _DEVICE.fullmatch(name):
        raise _invalid(name, "Choose another name: Windows keeps this one for a device.")
    if (take.bakes / name).exists():
        raise StudioError(
            "bakes.name_taken",
            f"a bake is already kept as '{name}'",
            file=take.bakes / name,
            value=name,
            fix=f"Choose another name, or remove it with `v3studio bakes remove TAKE {name}`.",
        )
    return name


def keep_bake(take: Take, name: str) -> KeptBake:
    """Keep the take's stream under a name. The caller holds the take's lock.

    Raises:
        StudioError: `bakes.invalid_name`, `bakes.name_taken`, there is no finished stream (`bakes.not_baked`), or files
            are not what the last finished bake or evaluation wrote (`take.damaged`).
        OSError: the disk is full, for example; nothing is left behind.
    """
    name = refuse_taken(take, name)
    record = read_record(take, "bake")
    if record is None or not (take.stream / "manifest.json").is_file():
        raise StudioError(
            "bakes.not_baked",
            "there is no finished bake to keep",
            file=take.root,
            fix="Run `v3studio bake` first.",
            stage="bake",
        )
    work = take.work("bake")
    notes = sorted(work.glob("group_*.json"))
    with atomic_path(take.bakes / name, durable=True) as folder:
        _link_files(take, folder, record)
        for path in notes:
            link(path, folder / "notes" / path.name, durable=True)
        evaluate = _evaluation_of(take, record)
        if evaluate is not None:
            _link_files(take, folder, evaluate)
        note = KeptBakeNote(
            kept=datetime.datetime.now(datetime.UTC).isoformat(),
            bake=record,
            evaluate=evaluate,
            notes=tuple(path.name for path in notes),
        )
        for path in [path for path in folder.rglob("*") if path.is_dir()]:
            sync(path)
        write_model(folder / NOTE, note, durable=True)
    return kept_bake(take, name)


def note_evaluation(take: Take) -> list[str]:
    """Give kept bakes that are the take's stream its new evaluation; returns their names. The caller holds the lock.

    Raises:
        StudioError: the evaluation is not what was recorded (`take.damaged`).
        OSError: a file cannot be written.
    """
    told = []
    for kept in kept_bakes(take):
        evaluate = _evaluation_of(take, kept.note.bake)
        if evaluate is not None and (kept.note.evaluate is None or kept.note.evaluate.result != evaluate.result):
            _link_files(take, kept.folder, evaluate)
            write_model(kept.folder / NOTE, kept.note.model_copy(update={"evaluate": evaluate}), durable=True)
            told.append(kept.name)
    return told


def check_removable(take: Take, names: Sequence[str]) -> None:
    """Check, before the first of several is removed, that all are there.

    Raises:
        StudioError: `bakes.not_found` or `bakes.invalid_name`.
    """
    for name in names:
        if not (take.bakes / check_name(name)).is_dir():
            kept_bake(take, name)


def remove_bake(take: Take, name: str) -> int:
    """Delete a kept bake; returns the bytes that are free again. The take's stream stays, also if it is the same.

    Raises:
        StudioError: `bakes.not_found` or `bakes.invalid_name`.
        OSError: it cannot be deleted.
    """
    check_removable(take, [name])
    path = take.bakes / check_name(name)
    frees = sum(state.st_size for state in _states(path) if state.st_nlink == 1)
    gone = temporary_path(path)
    os.rename(path, gone)  # in one step: a killed removal leaves no half of it
    remove(gone)
    if not any(take.bakes.iterdir()):
        take.bakes.rmdir()
    return frees


def refuse_damaged(take: Take, kept: KeptBake) -> None:
    """Compare the files of a kept bake with what was recorded.

    Raises:
        StudioError: a file is not as it was (`take.damaged`).
    """
    for name, problem in changed_files(kept):
        if problem:
            raise _damaged(take, kept, kept.folder / name, problem)


def refuse_missing(take: Take, kept: KeptBake, files: Iterable[Path]) -> None:
    """Check that files of a kept bake are there. Raises StudioError if one is not (`take.damaged`)."""
    for path in files:
        if not path.is_file():
            raise _damaged(take, kept, path, "missing")


def _damaged(take: Take, kept: KeptBake, path: Path, problem: Problem) -> StudioError:
    return StudioError(
        "take.damaged",
        f"the file is {problem}: it is not what was kept as '{kept.name}'",
        file=path,
        fix=f"Remove it with `v3studio bakes remove {take.root} '{kept.name}'`, and bake again.",
    )


def recorded_files(kept: KeptBake) -> list[tuple[str, str]]:
    """Files of a kept bake, relative to its folder, with the digests that were recorded ("" if there is none)."""
    records = [record for record in (kept.note.bake, kept.note.evaluate) if record is not None]
    return [(name, record.digests.get(name, "")) for record in records for name in record.files]


def changed_files(kept: KeptBake) -> Iterator[tuple[str, Problem | None]]:
    """Each file of a kept bake, relative to its folder, and what is wrong with it; None if it is as recorded."""
    for name, digest in recorded_files(kept):
        path = kept.folder / name
        if not path.is_file():
            yield name, "missing"
        else:
            yield name, "changed" if digest and digest_of_file(path) != digest else None


def _evaluation_of(take: Take, bake: StageRecord) -> StageRecord | None:
    """The record of the take's evaluation, if it measured this stream."""
    record = read_record(take, "evaluate")
    return record if record is not None and record.params.get("result of bake") == bake.result else None


def _link_files(take: Take, folder: Path, record: StageRecord) -> None:
    """Link the files that a stage wrote.

    Raises:
        StudioError: one is not as it was recorded, as after an interrupted run (`take.damaged`).
    """
    files = [take.root / name for name in record.files]
    changed = next((path for path in files if _is_changed(take, path, record)), None)
    if changed is None and not record.digests and digest_of_files(take.root, files) != record.result:
        changed = take.root
    if changed is not None:
        raise StudioError(
            "take.damaged",
            f"it is not what the stage {record.stage} wrote when it last finished",
            file=changed,
            fix=f"Run `v3studio {record.stage}` again, with --force if it finds nothing to do.",
            stage=record.stage,
        )
    for path, name in zip(files, record.files, strict=True):
        link(path, folder / name, durable=True)


def _is_changed(take: Take, path: Path, record: StageRecord) -> bool:
    name = path.relative_to(take.root).as_posix()
    if not path.is_file() or path.stat().st_size != record.files[name]:
        return True
    digest = record.digests.get(name)  # none in takes of earlier versions
    return digest is not None and digest_of_file(path) != digest


def link(source: Path, target: Path, durable: bool = False) -> None:
    """Hard-link or copy a file; `durable` as for `atomic_path`. Raises OSError."""
    with atomic_path(target, durable) as temporary:
        link_or_copy(str(source), str(temporary))
