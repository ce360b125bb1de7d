"""Runs the command line with a fault at the n-th write below a folder.

    python benchmarks/attack/faults.py KIND N FOLDER ARGUMENT...

Writes are what Python's audit events tell of: files opened for writing, renames, links, new and removed files and
folders. Writes of native libraries happen in files that Python renames into place, or are limited by `size`. Kinds:

- `count`: no fault; the number of writes is left beside the folder, in FOLDER.writes.
- `kill`: SIGKILL instead of the n-th write.
- `power`: the same, and all files that this run has written and not synced are empty, as after a power cut on a file
  system that had written their names only.
- `full`: no space is left from the n-th write on.
- `size`: no file can grow beyond n bytes.
"""

import errno
import os
import resource
import runpy
import signal
import sys
import time
from pathlib import Path
from typing import Any

from v3studio.studio.training import settings

_CHANGES = ("os.rename", "os.link", "os.symlink", "os.mkdir", "os.remove", "os.rmdir", "os.truncate")
_FREES = ("os.remove", "os.rmdir")


class Faults:
    """Counts the writes below a folder and makes one of them fail."""

    def __init__(self, kind: str, number: int, folder: Path) -> None:
        self.kind, self.number, self.folder = kind, number, str(folder.resolve())
        self.count = 0
        self._began = time.time_ns()
        self._synced: set[str] = set()
        if kind == "power":
            self._watch_syncs()
        sys.addaudithook(self)

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, mode, flags = arguments
            writes = any(letter in mode for letter in "wax+") if mode else (flags or 0) & (os.O_WRONLY | os.O_RDWR)
            if not writes:
                return
        elif event in _CHANGES:
            path = arguments[1] if event in ("os.rename", "os.link", "os.symlink") else arguments[0]
        else:
            return
        if isinstance(path, int) or not os.path.abspath(os.fsdecode(path)).startswith(self.folder):
            return
        self.count += 1
        if self.kind in ("kill", "power") and self.count == self.number:
            if self.kind == "power":
                self._lose()
            os.kill(os.getpid(), signal.SIGKILL)
        if self.kind == "full" and self.count >= self.number and event not in _FREES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), os.fsdecode(path))

    def _watch_syncs(self) -> None:
        fsync = os.fsync

        def watched(descriptor: Any) -> None:
            fsync(descriptor)
            number = descriptor if isinstance(descriptor, int) else descriptor.fileno()
            self._synced.add(str(os.fstat(number).st_ino))

        os.fsync = watched  # type: ignore[assignment]

    def _lose(self) -> None:
        for root, _, names in os.walk(self.folder):
            for name in names:
                path = os.path.join(root, name)
                about = os.lstat(path)
                if about.st_mtime_ns >= self._began and str(about.st_ino) not in self._synced:
                    os.truncate(path, 0)


def main() -> None:
    kind, number, folder, *arguments = sys.argv[1:]
    if kind == "size":
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(number), resource.RLIM_INFINITY))
    settings.CHECKPOINT_EVERY = 10  # tiny takes train 12 steps
    faults = Faults(kind, int(number), Path(folder))
    sys.argv = ["v3studio", *arguments]
    sys.modules.pop("v3studio.pipelines.cli", None)
    try:
        runpy.run_module("v3studio.pipelines.cli", run_name="__main__", alter_sys=True)
    finally:
        if kind == "count":
            Path(f"{folder}.writes").write_text(str(faults.count))


if __name__ == "__main__":
    main()
