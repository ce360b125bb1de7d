"""Records of finished and of failed stages."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from pydantic import Field, JsonValue, model_validator

from v3studio.pipelines.takes.files.digests import digest_of, digests_of_files
from v3studio.pipelines.takes.files.json_files import Result, cannot_read, read_model, write_model
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.json_types import JsonObject

Record = TypeVar("Record", bound=Result)


class RecordedWarning(Result):
    """A warning about the results of a stage."""

    message: str  # the sentence for people
    code: str = ""  # of the warning (`studio.errors.Message.code`)
    value: JsonValue = None
    fix: str = ""
    fields: dict[str, JsonValue] = Field(default_factory=dict)

    @property
    def group(self) -> int:
        """The group that it is about; the first for all of them."""
        group = self.fields.get("group")
        return group if isinstance(group, int) else 0


class StageRecord(Result):
    """.v3studio/stages/STAGE.json: what a finished stage was made from and what it wrote."""

    stage: str
    params: dict[str, JsonValue]
    """Settings by dotted name, digests of inputs and of the results of other stages."""

    result: str
    """Digest of the files that the stage wrote."""

    files: dict[str, int] = Field(default_factory=dict)
    """Size in bytes by path relative to the take."""

    digests: dict[str, str] = Field(default_factory=dict)
    """`digest_of_file` by path relative to the take."""

    written: dict[str, int] = Field(default_factory=dict)
    """Modification time in ns by path relative to the take."""

    seconds: float | None = None
    """Work time, without pauses."""

    finished: str = ""
    """UTC, ISO 8601."""

    summary: dict[str, JsonValue] = Field(default_factory=dict)
    """The stage's summary, as in the event `stage_finished`."""

    warnings: tuple[RecordedWarning, ...] = ()
    """Warnings about the results, which hold until the stage runs again without them."""

    @model_validator(mode="after")
    def _names_lie_in_the_take(self) -> StageRecord:
        for name in {*self.files, *self.digests, *self.written}:
            parts = name.split("/")
            if not all(part not in ("", ".", "..") and len(part.encode("utf-8", "replace")) < 256 for part in parts):
                raise ValueError(f"'{name[:80]}' is not the path of a file in the take")
            if "\0" in name or "\\" in name:
                raise ValueError("a path has a character that no file of a take has")
        if self.written.keys() - self.files.keys() or self.digests.keys() - self.files.keys():
            raise ValueError("a file has a time or a digest, but no size")
        return self


class FailureRecord(Result):
    """.v3studio/stages/STAGE.failed.json: why the last attempt failed."""

    stage: str
    message: str  # the sentence for people
    code: str = ""  # of the error (`studio.errors.Message.code`)

    error: dict[str, JsonValue] = Field(default_factory=dict)
    """`studio.errors.Message.to_dict`: file, value, fix and other fields."""


def read_record(take: Take, stage: str) -> StageRecord | None:
    """The record of a finished stage; None if it never finished, or the record is damaged: it runs again. Raises
    StudioError if it cannot be read now (`take.cannot_read`)."""
    return _read(take.record(stage), StageRecord)


def note_rewritten(take: Take, stage: str) -> None:
    """Update a stage's record after the program rewrote its files without changing their meaning."""
    record = read_record(take, stage)
    if record is not None:
        fields = on_disk(take.root, [take.root / name for name in record.files])
        write_model(take.record(stage), record.model_copy(update=fields))


def on_disk(root: Path, files: Iterable[Path]) -> JsonObject:
    """The fields of a record about the files that a stage wrote: result, files, digests, written."""
    digests = digests_of_files(root, files)
    stats = {name: (root / name).stat() for name in digests}
    return {
        "result": digest_of(digests),
        "digests": digests,
        "files": {name: stat.st_size for name, stat in stats.items()},
        "written": {name: stat.st_mtime_ns for name, stat in stats.items()},
    }


def digests_on_record(take: Take, *stages: str) -> dict[Path, str]:
    """Digests of finished stages' files that have not been written since, by path; without reading them."""
    digests = dict[Path, str]()
    for record in filter(None, (read_record(take, stage) for stage in stages)):
        for name, digest in record.digests.items():
            path = take.root / name
            with contextlib.suppress(OSError):
                state = path.stat()
                if (state.st_mtime_ns, state.st_size) == (record.written.get(name), record.files.get(name)):
                    digests[path] = digest
    return digests


def result_of(take: Take, stage: str) -> str | None:
    """Digest of a finished stage's results; None if it is not finished."""
    path = take.record(stage)
    try:
        state = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise cannot_read(path, error) from None
    return _result_of(take, stage, state.st_ino, state.st_mtime_ns)


@lru_cache(maxsize=64)
def _result_of(take: Take, stage: str, inode: int, written: int) -> str | None:
    """Records of long takes are large, and every group asks. They are replaced as a whole, with a new inode."""
    record = read_record(take, stage)
    return record.result if record else None


def write_failure(take: Take, stage: str, error: Message) -> None:
    record = FailureRecord(stage=stage, message=str(error), code=error.code, error=error.to_dict())
    write_model(take.failure(stage), record)


def read_failure(take: Take, stage: str) -> FailureRecord | None:
    """Return why the stage's last attempt failed; None if it did not, or the record is damaged."""
    return _read(take.failure(stage), FailureRecord)


def _read(path: Path, model: type[Record]) -> Record | None:
    try:
        return read_model(path, model)
    except StudioError as error:
        if error.code == "take.cannot_read":
            raise
        return None
