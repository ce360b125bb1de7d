"""A folder on a network file system that shows what other machines write with a delay.

Clients of such file systems cache which files a folder has, and what they know of each, for up to a minute. Until then
this process sees the files that were there when it began, and no new ones. What it has written itself it sees at once,
and opening a file for writing, locks, renames and removals reach the server, as they do there. Files that native
libraries open by themselves are seen at once.
"""

from __future__ import annotations

import builtins
import contextlib
import io
import os
import shutil
import stat
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

_REAL = SimpleNamespace(
    open=io.open,
    os_open=os.open,
    stat=os.stat,
    lstat=os.lstat,
    scandir=os.scandir,
    listdir=os.listdir,
    rename=os.rename,
    replace=os.replace,
    link=os.link,
    mkdir=os.mkdir,
)


class LateFiles:
    """What this process sees of a folder.

    Args:
        folder: the folder.
        seconds: how long changes by others are hidden.
        seen: what is seen until then; a copy of the folder as it is now if it does not exist.
    """

    def __init__(self, folder: Path, seconds: float, seen: Path) -> None:
        self.folder, self.seconds, self.seen = str(folder.resolve()), seconds, str(seen)
        self._own: set[int] = set()
        self._made: set[str] = set()
        if not seen.exists():
            shutil.copytree(folder, seen) if folder.exists() else seen.mkdir()

    def place(self, path: Any) -> Any:
        """Where the content of a path is for this process."""
        if isinstance(path, int):
            return path
        full = os.path.abspath(os.fsdecode(path))
        if not self._is_late(full):
            return path
        return self.seen + full[len(self.folder) :]

    def wrote(self, path: Any) -> None:
        """Note that this process has made this file."""
        with contextlib.suppress(OSError):
            self._own.add(_REAL.stat(path).st_ino)

    def made(self, path: Any) -> None:
        """Note that this process has made this folder; native libraries write into such."""
        self._made.add(os.path.abspath(os.fsdecode(path)))

    def _is_late(self, full: str) -> bool:
        if not full.startswith(self.folder + os.sep) or os.path.dirname(full) in self._made:
            return False
        try:
            about = _REAL.lstat(full)
        except OSError:
            return False  # removed: the server says so when it is asked for the file
        changed = max(about.st_mtime, about.st_ctime)
        hidden = about.st_ino not in self._own and changed > time.time() - self.seconds
        return hidden and not stat.S_ISDIR(about.st_mode)

    def hides(self, full: str) -> bool:
        """Whether an entry of a folder is not listed yet."""
        return self._is_late(full) and not os.path.lexists(self.seen + full[len(self.folder) :])


def install(folder: Path, seconds: float) -> None:
    """From now on, this process sees `folder` so. FOLDER.seen holds what it sees of others' files meanwhile."""
    late = LateFiles(folder, seconds, folder.with_name(f"{folder.name}.seen"))

    def opened(path: Any, mode: str = "r", *rest: Any, **options: Any) -> Any:
        if not any(letter in mode for letter in "wax+"):
            return _REAL.open(late.place(path), mode, *rest, **options)
        file = _REAL.open(path, mode, *rest, **options)
        late.wrote(file.fileno())
        return file

    def os_opened(path: Any, flags: int, *rest: Any, **options: Any) -> int:
        if not flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            return int(_REAL.os_open(late.place(path), flags, *rest, **options))
        descriptor = int(_REAL.os_open(path, flags, *rest, **options))
        late.wrote(descriptor)
        return descriptor

    def moved(real: Any) -> Any:
        def move(source: Any, target: Any, **options: Any) -> None:
            real(source, target, **options)
            late.wrote(target)
            if os.path.isdir(target):
                late.made(target)

        return move

    def made(path: Any, *rest: Any, **options: Any) -> None:
        _REAL.mkdir(path, *rest, **options)
        late.made(path)

    def about(real: Any) -> Any:
        def asked(path: Any, **options: Any) -> Any:
            return real(late.place(path) if "dir_fd" not in options else path, **options)

        return asked

    def listed(path: Any = ".") -> list[Any]:
        names = _REAL.listdir(path)
        return [name for name in names if isinstance(path, int) or not late.hides(_below(path, name))]

    builtins.open = io.open = opened  # type: ignore[assignment]
    os.open, os.mkdir = os_opened, made
    os.stat, os.lstat = about(_REAL.stat), about(_REAL.lstat)
    os.rename, os.replace, os.link = (moved(real) for real in (_REAL.rename, _REAL.replace, _REAL.link))
    os.listdir, os.scandir = listed, lambda path=".": _Entries(late, path)  # type: ignore[assignment]


def _below(path: Any, name: Any) -> str:
    return os.path.join(os.path.abspath(os.fsdecode(path)), os.fsdecode(name))


class _Entries:
    """What `os.scandir` gives, without what is hidden."""

    def __init__(self, late: LateFiles, path: Any) -> None:
        self._late, self._path, self._entries = late, path, _REAL.scandir(path)

    def __iter__(self) -> _Entries:
        return self

    def __next__(self) -> os.DirEntry[Any]:
        while True:
            entry: os.DirEntry[Any] = next(self._entries)
            if isinstance(self._path, int) or not self._late.hides(_below(self._path, entry.name)):
                return entry

    def __enter__(self) -> _Entries:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._entries.close()
