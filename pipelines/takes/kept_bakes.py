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
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, JsonValue, field_validator

from pipelines.takes.atomic_files import Result, digest_of_file, link_or_copy, read_model, remove, write_model
from pipelines.takes.evaluation import read_evaluation
from pipelines.takes.records import StageRecord, current_record, read_record, result_of
from pipelines.takes.settings_file import set_settings
from pipelines.takes.take import Take
from studio.atomic_files import atomic_path, exchange, temporary_path
from studio.errors import StudioError

NOTE = "bake.json"
"""Written last: a folder without it is not a kept bake."""

Problem = Literal["changed", "missing"]

_NAME = re.compile(r"[^\W_][\w .-]{0,59}")


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
    """

    name: str
    folder: Path
    note: KeptBakeNote
    bytes: int
    frees: int
    chosen: bool
    current: bool

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
    found = []
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if _NAME.fullmatch(path.name) and (path / NOTE).is_file():
            with contextlib.suppress(StudioError):
                found.append(_kept(take, path))
    return sorted(found, key=lambda kept: (kept.note.kept, kept.name))


def kept_bake(take: Take, name: str) -> KeptBake:
    """The kept bake of a name.

    Raises:
        StudioError: there is none (`bakes.not_found`), the name cannot be one (`bakes.invalid_name`), or its note is
            damaged (`take.damaged`).
    """
    check_name(name)
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
    return _kept(take, path)


def _kept(take: Take, path: Path) -> KeptBake:
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
    )


def _states(folder: Path) -> Iterator[os.stat_result]:
    for path in folder.rglob("*"):
        if path.is_file():
            yield path.stat()


def check_name(name: str) -> None:
    """Check a name for a kept bake.

    Raises:
        StudioError: it cannot be the name of a folder on every system (`bakes.invalid_name`).
    """
    if not _NAME.fullmatch(name) or name[-1] in " ." or len(name.encode()) > 120:
        raise StudioError(
            "bakes.invalid_name",
            f"'{name}' cannot be the name of a bake",
            value=name,
            fix="Use up to 60 letters, digits, spaces and . - _, beginning with a letter or a digit.",
        )


def refuse_taken(take: Take, name: str) -> None:
    """Check, before a long run, that a bake can be kept under a name.

    Raises:
        StudioError: `bakes.invalid_name`, or another bake has it (`bakes.name_taken`).
    """
    check_name(name)
    if (take.bakes / name).exists():
        raise StudioError(
            "bakes.name_taken",
            f"a bake is already kept as '{name}'",
            file=take.bakes / name,
            value=name,
            fix=f"Choose another name, or remove it with `v3studio bakes remove TAKE {name}`.",
        )


def keep_bake(take: Take, name: str) -> KeptBake:
    """Keep the take's stream under a name. The caller holds the take's lock.

    Raises:
        StudioError: `bakes.invalid_name`, `bakes.name_taken`, or there is no finished stream (`bakes.not_baked`).
        OSError: the disk is full, for example; nothing is left behind.
    """
    refuse_taken(take, name)
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
    with atomic_path(take.bakes / name) as folder:
        _link_files(take.root, folder, record)
        for path in notes:
            _link(path, folder / "notes" / path.name)
        evaluate = _evaluation_of(take, record)
        if evaluate is not None:
            _link_files(take.root, folder, evaluate)
        note = KeptBakeNote(
            kept=datetime.datetime.now(datetime.UTC).isoformat(),
            bake=record,
            evaluate=evaluate,
            notes=tuple(path.name for path in notes),
        )
        write_model(folder / NOTE, note)
    return kept_bake(take, name)


def note_evaluation(take: Take) -> list[str]:
    """Give kept bakes that are the take's stream its new evaluation; returns their names. The caller holds the lock."""
    told = []
    for kept in kept_bakes(take):
        evaluate = _evaluation_of(take, kept.note.bake)
        if evaluate is not None and (kept.note.evaluate is None or kept.note.evaluate.result != evaluate.result):
            _link_files(take.root, kept.folder, evaluate)
            write_model(kept.folder / NOTE, kept.note.model_copy(update={"evaluate": evaluate}))
            told.append(kept.name)
    return told


def choose_bake(take: Take, name: str, *, discard: bool = False) -> KeptBake:
    """Make a kept bake the take's stream, with its settings and its evaluation. The caller holds the lock.

    The bake stays kept. If this is interrupted, the take has no finished bake until it is repeated; the kept bakes are
    whole at every moment.

    Args:
        take: the take.
        name: of the kept bake.
        discard: the present stream may be lost although it is not kept under any name.

    Raises:
        StudioError: `bakes.not_found`, `bakes.invalid_name`, files of the kept bake are damaged (`take.damaged`), or
            the present stream is not kept (`bakes.would_be_lost`).
        OSError: a file cannot be written.
    """
    kept = kept_bake(take, name)
    refuse_damaged(take, kept)
    if not discard and not _stream_is_kept(take):
        raise StudioError(
            "bakes.would_be_lost",
            "the present stream is not kept under a name and would be lost",
            file=take.stream,
            fix="Keep it with `v3studio bakes keep TAKE NAME`, or add --discard.",
        )
    for stage in ("evaluate", "bake"):
        take.forget(stage)
    set_settings(take.config, kept.settings)
    _put_stream(take, kept)
    notes = take.work("bake")
    remove(notes)
    for file in kept.note.notes:
        _link(kept.folder / "notes" / file, notes / file)
    for path in (take.evaluation, take.report):
        if kept.note.evaluate is not None:
            _link(kept.folder / path.name, path)
        else:
            remove(path)
    write_model(take.record("bake"), kept.note.bake)
    if kept.note.evaluate is not None:
        write_model(take.record("evaluate"), kept.note.evaluate)
    return kept_bake(take, name)


def _stream_is_kept(take: Take) -> bool:
    """Whether nothing is lost with the present stream. Its record does not tell after an interrupted `choose_bake`."""
    manifest = take.stream / "manifest.json"
    if not manifest.is_file():
        return True
    digest = digest_of_file(manifest)
    return any(dict(recorded_files(kept)).get("stream/manifest.json") == digest for kept in kept_bakes(take))


def check_removable(take: Take, names: Sequence[str]) -> None:
    """Check, before the first of several is removed, that all are there.

    Raises:
        StudioError: `bakes.not_found` or `bakes.invalid_name`.
    """
    for name in names:
        check_name(name)
        if not (take.bakes / name).is_dir():
            kept_bake(take, name)


def remove_bake(take: Take, name: str) -> int:
    """Delete a kept bake; returns the bytes that are free again. The take's stream stays, also if it is the same.

    Raises:
        StudioError: `bakes.not_found` or `bakes.invalid_name`.
        OSError: it cannot be deleted.
    """
    check_removable(take, [name])
    path = take.bakes / name
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
            raise StudioError(
                "take.damaged",
                f"the file is {problem}: it is not what was kept as '{kept.name}'",
                file=kept.folder / name,
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


def _link_files(root: Path, folder: Path, record: StageRecord) -> None:
    for name in record.files:
        _link(root / name, folder / name)


def _link(source: Path, target: Path) -> None:
    with atomic_path(target) as temporary:
        link_or_copy(str(source), str(temporary))


def _put_stream(take: Take, kept: KeptBake) -> None:
    """Replace the take's stream, in one step where the system can."""
    new = temporary_path(take.stream)
    try:
        shutil.copytree(kept.stream, new, copy_function=link_or_copy)
        if not take.stream.exists():
            os.rename(new, take.stream)
        elif not exchange(new, take.stream):
            old = temporary_path(take.stream)
            os.rename(take.stream, old)
            os.rename(new, take.stream)
            remove(old)
    finally:
        remove(new)
