"""Atomic writes: a file appears complete or not at all."""

from __future__ import annotations

import ctypes
import errno
import json
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

PARTIAL = ".partial"
"""Part of every temporary name. Remaining files with this name are leftovers of killed processes and may be deleted."""

_HERE = -100  # AT_FDCWD: relative paths are from the working folder
_EXCHANGE = 2  # RENAME_EXCHANGE


@contextmanager
def atomic_path(path: Path, durable: bool = False) -> Iterator[Path]:
    """A temporary path in the same folder that is renamed to `path` on success and deleted on any exception.

    The temporary name has the same suffix, since some writers select the format by it. The parent folder is created.

    Args:
        path: the final name.
        durable: the file's bytes are on the disk before it gets its name: a power cut leaves the old file or the new
            one, not an empty one. That takes up to 50 ms; it is for what cannot be made again.

    Raises:
        OSError: the folder cannot be created or the file cannot be renamed.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_path(path)
    try:
        yield temporary
        if durable:
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        remove(temporary)
        raise


def temporary_path(path: Path, what: str = "") -> Path:
    """The temporary name of this process for a file or folder; `what` tells several apart (".old")."""
    return path.with_name(f".{path.stem}.{os.getpid()}{what}{PARTIAL}{path.suffix}")


def leftovers(folder: Path, of: Path | None = None, what: str = "") -> list[Path]:
    """Temporary files and folders in a folder whose process has ended, as after kill -9.

    Processes of other machines, which the numbers in the names do not tell, count as ended: do not write to one target
    from two machines at once.

    Args:
        folder: where to look, not in the folders in it.
        of: only those for this file or folder; None: all.
        what: as for `temporary_path`.
    """
    stem, suffix = (r".+", r"(\.[^.]*)?") if of is None else (re.escape(of.stem), re.escape(of.suffix))
    named = re.compile(rf"\.{stem}\.(?P<pid>[0-9]{{1,9}}){re.escape(what + PARTIAL)}{suffix}")
    found = [(path, named.fullmatch(path.name)) for path in (folder.iterdir() if folder.is_dir() else ())]
    return sorted(path for path, match in found if match is not None and not _running(int(match["pid"])))


def is_being_written(path: Path) -> bool:
    """Whether a file or folder has the temporary name of another process that runs."""
    named = re.fullmatch(rf"\..+\.([0-9]{{1,9}})(\.[a-z]+)?{re.escape(PARTIAL)}(\.[^.]*)?", path.name)
    return named is not None and int(named[1]) != os.getpid() and _running(int(named[1]))


def remove_leftovers(folder: Path, of: Path | None = None) -> None:
    """Delete `leftovers`; what cannot be deleted stays."""
    for path in leftovers(folder, of):
        with suppress(OSError):
            remove(path)


def _running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


def exchange(first: Path, second: Path) -> bool:
    """Swap two files or folders of one file system in a single step: others see either state, never neither.

    Returns:
        False, with nothing changed, where the system cannot (renameat2 is Linux's; some network file systems lack it).

    Raises:
        OSError: one does not exist, or may not be renamed.
    """
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if renameat2 is None:
        return False
    if renameat2(_HERE, os.fsencode(first), _HERE, os.fsencode(second), _EXCHANGE) == 0:
        return True
    number = ctypes.get_errno()
    if number in (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP):
        return False
    raise OSError(number, os.strerror(number), str(first), None, str(second))


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file atomically.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path, text: str, durable: bool = False) -> None:
    """Write UTF-8 text atomically; `durable` as for `atomic_path`.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic_path(path, durable) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any, durable: bool = False) -> None:
    """Write indented JSON with a final newline, atomically; `durable` as for `atomic_path`.

    Raises:
        ValueError: the value contains NaN or infinity, which JSON does not support.
        OSError: the file cannot be written.
    """
    write_text(path, json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n", durable)


def remove(path: Path) -> None:
    """Delete a file or a folder; does nothing if it does not exist."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
