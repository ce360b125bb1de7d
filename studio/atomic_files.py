"""Atomic writes: a file appears complete or not at all. Locks of files that several processes change."""

import errno
import fcntl
import hashlib
import json
import logging
import os
import re
import secrets
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import IO, Any

from v3studio.studio.errors import Message, StudioError

PARTIAL = ".partial"
"""Part of every temporary name. Remaining files with this name are leftovers of killed processes and may be deleted."""

_NAMED = rf"(?P<pid>[0-9]{{1,9}})-(?P<machine>[0-9a-f]{{8}})-[0-9a-f]{{8}}(?P<what>\.[a-z]+)?{re.escape(PARTIAL)}"
"""Middle of a temporary name."""

_ABANDONED_SECONDS = 3600.0
"""Temporary files of other machines, whose processes are not known here, are leftovers if unwritten for so long."""


@contextmanager
def atomic_path(path: Path, durable: bool = False) -> Iterator[Path]:
    """A temporary path in the same folder that is renamed to `path` on success and deleted on any exception.

    The temporary name has the same suffix, since some writers select the format by it. The parent folder is created. A
    StudioError of the block gets the final name. `durable`: the file's bytes are on the disk before it gets its name: a
    power cut leaves the old file or the new one, not an empty one. That takes up to 50 ms; it is for what cannot be
    made again.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_path(path)
    try:
        yield temporary
        if durable:
            sync(temporary)
        os.replace(temporary, path)
    except BaseException as error:
        remove(temporary)
        if isinstance(error, StudioError) and error.file and Path(error.file).is_relative_to(temporary):
            final = path / Path(error.file).relative_to(temporary)
            raise type(error).of(replace(error.message, file=final)) from None
        raise


def sync(path: Path) -> None:
    """Wait until a file's bytes, or a folder's names, are on the disk; OSError if a file cannot be opened or written.
    Folders that cannot be synced, as on some network file systems, are left as they are."""
    with suppress(OSError) if path.is_dir() else nullcontext():
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def temporary_path(path: Path, what: str = "") -> Path:
    """A temporary name for a file or folder, different in each call; `what`, a dot and letters, tells several apart
    (".old"). It tells the process and its machine: processes of several machines may write to one shared folder."""
    writer = f"{os.getpid()}-{machine_name()}-{secrets.token_hex(4)}"
    return path.with_name(f".{path.stem}.{writer}{what}{PARTIAL}{path.suffix}")


def leftovers(folder: Path, of: Path | None = None, what: str = "") -> list[Path]:
    """Temporary files and folders in a folder (`of`: only those for this one) whose process has ended, as after kill
    -9. Those of other machines are leftovers if nothing was written to them for an hour."""
    stem, suffix = (r".+", r"(\.[^.]*)?") if of is None else (re.escape(of.stem), re.escape(of.suffix))
    named = re.compile(rf"\.{stem}\.{_NAMED}{suffix}")
    matches = [(path, named.fullmatch(path.name)) for path in (folder.iterdir() if folder.is_dir() else ())]
    return sorted(
        path
        for path, match in matches
        if match is not None and (match["what"] or "") == what and not _has_writer(path, match)
    )


def is_being_written(path: Path) -> bool:
    """Return whether a file or folder has the temporary name of another process that runs, or may run on another
    machine."""
    named = re.fullmatch(rf"\..+\.{_NAMED}(\.[^.]*)?", path.name)
    own = str(os.getpid()), machine_name()
    return named is not None and (named["pid"], named["machine"]) != own and _has_writer(path, named)


def _has_writer(path: Path, named: re.Match[str]) -> bool:
    """Return whether the process in a temporary name runs, or may run."""
    if named["machine"] == machine_name():
        import psutil

        return psutil.pid_exists(int(named["pid"]))
    return time.time() - _last_written(path) < _ABANDONED_SECONDS


def _last_written(path: Path) -> float:
    """Time at which a file, or one in a folder, was last changed; seconds since the epoch, 0 if it does not exist any
    more."""
    last = 0.0
    for inner in (path, *path.rglob("*")):
        with suppress(FileNotFoundError):
            last = max(last, inner.lstat().st_mtime)
    return last


@cache
def machine_name() -> str:
    """8 hex digits for where this process's id is valid: the machine, or the container."""
    place = socket.gethostname()
    with suppress(OSError):  # containers may share the machine's name
        place += f" {os.stat('/proc/self/ns/pid').st_ino}"
    return hashlib.sha256(place.encode()).hexdigest()[:8]


def remove_leftovers(folder: Path, of: Path | None = None) -> None:
    """Delete `leftovers`; what cannot be deleted stays."""
    for path in leftovers(folder, of):
        with suppress(OSError):
            remove(path)


def restore_old(path: Path) -> None:
    """Put back what a killed process left as `temporary_path(path, ".old")`; delete it if `path` exists. OSError."""
    for old in leftovers(path.parent, path, ".old"):
        if os.path.lexists(path):
            remove(old)
        else:
            os.rename(old, path)


def write_bytes(path: Path, data: bytes, durable: bool = False) -> None:
    """Write a file atomically; `durable` as for `atomic_path`. Raises OSError: the file cannot be written."""
    with atomic_path(path, durable) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path, text: str, durable: bool = False) -> None:
    """Write UTF-8 text atomically; `durable` as for `atomic_path`. Raises OSError: the file cannot be written."""
    with atomic_path(path, durable) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any, durable: bool = False) -> None:
    """Write indented JSON with a final newline, atomically; `durable` as for `atomic_path`. ValueError if the value
    contains NaN or infinity, which JSON does not support; OSError if the file cannot be written."""
    write_text(path, json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n", durable)


def remove(path: Path) -> None:
    """Delete a file or a folder; does nothing if it does not exist."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def link_or_copy(source: str, target: str) -> None:
    """Hard-link a file where the file system allows it, else copy it."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
told_of_locks = threading.Event()


def lock(
    file: IO[Any] | int, *, shared: bool = False, wait: bool = True, tell: Callable[[Message], None] | None = None
) -> bool:
    """Lock an open file until it is closed, or its process ends for any reason.

    Returns False if the file system has no locks: nothing is locked then, and `tell` hears once in the life of this
    process what cannot be promised (default: it is logged). Raises BlockingIOError if the file is locked and `wait` is
    False.
    """
    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    try:
        fcntl.flock(file, kind if wait else kind | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        if not told_of_locks.is_set():
            told_of_locks.set()
            problem = "this file system has no locks: if two machines change the same take or queue at once, changes "
            problem += "may be lost"
            fix = "Use one machine at a time, or mount it with locks (NFS 4; Lustre with -o flock)."
            place = None if isinstance(file, int) else file.name
            message = Message("files.no_locks", problem, place, fix=fix)
            if tell is None:
                logging.getLogger(__name__).warning("%s", message)
            else:
                tell(message)
        return False
    return True
