"""Files of a take: atomic writes, JSON, digests, locks, and disk errors as StudioError."""

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import shutil
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from v3studio.studio.atomic_files import (
    PARTIAL,
    atomic_path,
    is_being_written,
    remove,
    write_bytes,
    write_json,
    write_text,
)
from v3studio.studio.bounded_files import BOUNDS, TextError, parse_json, read_bounded
from v3studio.studio.errors import StudioError, first_violation, reason_of
from v3studio.studio.json_types import JsonObject

__all__ = [
    "Result",
    "atomic_path",
    "changing",
    "digest_of",
    "digest_of_file",
    "digests_of_files",
    "disk_errors",
    "held",
    "holder_of",
    "link_or_copy",
    "read_json",
    "read_model",
    "remove",
    "sweep_partial",
    "validated",
    "write_bytes",
    "write_json",
    "write_model",
    "write_text",
]


class Result(BaseModel):
    """Base of the models of JSON files in a take. Unknown keys, written by a later version, are kept."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False, use_attribute_docstrings=True)

    def to_json(self) -> JsonObject:
        """JSON-ready; fields that were never set are left out."""
        return self.model_dump(mode="json", exclude_unset=True)


Model = TypeVar("Model", bound=BaseModel)


def read_json(path: Path, limit: int = BOUNDS.size) -> Any:
    """The values in a file of at most `limit` bytes. Raises StudioError: `take.file_not_found`, `take.damaged`."""
    try:
        return parse_json(read_bounded(path, limit))
    except FileNotFoundError:
        raise StudioError("take.file_not_found", "no such file", file=path) from None
    except (OSError, TextError) as error:
        raise StudioError("take.damaged", f"cannot be read ({reason_of(error)})", file=path, fix=_AGAIN) from None


def read_model(path: Path, model: type[Model]) -> Model:
    """Read a JSON file that `write_model` wrote. Raises StudioError: `take.file_not_found`, `take.damaged`."""
    return validated(path, read_json(path), model)


def validated(path: Path, values: Any, model: type[Model]) -> Model:
    """The model of what was read from a JSON file."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        where, problem = first_violation(error)
        raise StudioError("take.damaged", problem, file=path, fix=_AGAIN, key=where) from None


def write_model(path: Path, value: BaseModel, durable: bool = False) -> None:
    """Write a model as indented JSON, atomically, without fields never set. `durable`: as for `atomic_path`."""
    write_json(path, value.model_dump(mode="json", exclude_unset=True), durable)


def sweep_partial(folder: Path) -> int:
    """Delete partially written files and folders that killed runs left under `folder`, and results that are empty, as
    a power cut leaves files whose names were on the disk before their bytes; returns how many.

    Those of processes that still run stay: marks are written, and exports made, while a run continues. So do those of
    other machines until nothing was written to them for an hour: groups may be worked on there.
    """
    found = _leftovers(folder)
    for path in found:
        remove(path)
    return len(found)


_NEVER_EMPTY = (".json", ".safetensors", ".checkpoint", ".ply")
_MADE_BY_PEOPLE = ("camera_path.json", "edits.json", "marks.json")


def _leftovers(folder: Path) -> list[Path]:
    """What `sweep_partial` deletes. Empty files are those of kinds that this program never writes empty, but not what a
    person made, and no temporary ones: those that are being written begin empty."""
    found = []
    for root, folders, names in os.walk(folder):
        for name in [name for name in (*folders, *names) if PARTIAL in name]:
            path = Path(root, name)
            set_aside = f".old{PARTIAL}" in name  # `restore_old` puts it back
            if name.startswith(".") and not set_aside and not is_being_written(path):
                found.append(path)
        folders[:] = [name for name in folders if PARTIAL not in name]
        for name in names:
            if name.endswith(_NEVER_EMPTY) and PARTIAL not in name and name not in _MADE_BY_PEOPLE:
                with contextlib.suppress(FileNotFoundError):
                    if os.lstat(file := os.path.join(root, name)).st_size == 0:
                        found.append(Path(file))
    return found


def digest_of(value: Any) -> str:
    """24 hex digits of the SHA-256 of a JSON-ready value; the order of keys does not matter."""
    text = json.dumps(value, sort_keys=True, ensure_ascii=False, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def digest_of_file(path: Path) -> str:
    """24 hex digits of the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:24]


def digests_of_files(folder: Path, files: Iterable[Path]) -> dict[str, str]:
    """`digest_of_file` by path relative to `folder`."""
    return {path.relative_to(folder).as_posix(): digest_of_file(path) for path in files}


def link_or_copy(source: str, target: str) -> None:
    """Hard-link a file where the file system allows it, else copy it."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


_DISK_FAILED = (errno.EIO, errno.ESTALE, errno.EREMOTEIO)
_DISK_GONE = (errno.ENODEV, errno.ENXIO, errno.ETIMEDOUT, errno.EHOSTDOWN)
"""Sockets and other devices fail with these numbers too, but their errors name no file."""


@contextmanager
def disk_errors(folder: Path) -> Iterator[None]:
    """Turn what a disk does to any program inside the block into a StudioError: it is full, fails, or refuses."""
    try:
        yield
    except OSError as error:
        file = folder if error.filename is None or PARTIAL in os.fsdecode(error.filename) else error.filename
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            fix = "Free some space and run again; finished work is kept."
            raise StudioError("take.disk_full", "the disk is full", file=folder, fix=fix) from error
        if error.errno == errno.EFBIG:
            problem = "a file would be larger than the file system, or a limit of this session, allows"
            fix = (
                "Look at `ulimit -f`, or choose a folder on another file system, and run again; finished work is kept."
            )
            raise StudioError("take.file_too_large", problem, file=file, fix=fix) from error
        if error.errno in _DISK_FAILED or (error.errno in _DISK_GONE and error.filename is not None):
            problem = f"the disk cannot be read or written ({error.strerror})"
            fix = "Check the disk or the network drive and run again; finished work is kept."
            raise StudioError("take.disk_failed", problem, file=file, fix=fix) from error
        if error.errno in (errno.ENOTDIR, errno.EEXIST):
            problem = "cannot be written: a part of the path is a file, not a folder"
            raise StudioError("take.not_writable", problem, file=file, fix="Choose another folder.") from error
        if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            problem = f"cannot be written ({error.strerror})"
            raise StudioError("take.not_writable", problem, file=file, fix="Choose another folder.") from error
        raise


@contextmanager
def changing(path: Path) -> Iterator[None]:
    """Changes of a file in a take by all processes, one after the other; a killed process holds no lock."""
    if not path.parent.is_dir():  # a take that was removed stays so
        raise StudioError("take.not_found", "no such folder", file=path.parent, fix="Was the take moved or deleted?")
    private = path.parent / ".v3studio"
    with disk_errors(path.parent):
        private.mkdir(exist_ok=True)
        with (private / f"{path.stem}.lock").open("a") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield


@contextmanager
def held(path: Path, refused: Callable[[JsonObject], StudioError], **about: str) -> Iterator[None]:
    """Lock a file for this process, whose `pid` and `host` are written to it with `about`; the kernel releases it when
    the process ends for any reason. `refused`: what to raise if another one holds it, of what `holder_of` says."""
    with path.open("a") as file:
        for _ in range(5):  # who only asks whether it is locked holds it briefly
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            time.sleep(0.05)
        else:
            raise refused(holder_of(path) or {})
        file.truncate(0)
        file.write(json.dumps({"pid": os.getpid(), "host": socket.gethostname(), **about}))
        file.flush()
        try:
            yield
        finally:  # before the lock is released: the next process must never seem to be this one
            file.truncate(0)


def holder_of(path: Path) -> JsonObject | None:
    """`pid`, `host` and what else the process that holds a lock says; {}: it has not said it yet; None: none does."""
    with contextlib.suppress(FileNotFoundError), path.open("r") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            with contextlib.suppress(ValueError):
                return dict(parse_json(file.read()))
            return {}
    return None


_AGAIN = "Delete it and run again."
