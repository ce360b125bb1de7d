"""The folder in which a machine keeps copies of objects from stores, and its limit."""

import math
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from v3studio.studio.atomic_files import lock
from v3studio.studio.errors import StudioError

DEFAULT_GIGABYTES = 100.0  # of the cache, unless V3STUDIO_CACHE_GIGABYTES says otherwise
_KEEP = 0.9  # share of the limit that is left when something had to go
_CHECK_SHARE = 0.02  # the cache is measured again when a process has added this share of the limit


def cache_folder() -> Path:
    """V3STUDIO_CACHE, or v3studio in the user's cache folder. On a local disk: it is shared by the processes of one
    machine, and locks files."""
    named = os.environ.get("V3STUDIO_CACHE")
    if named:
        return Path(named).expanduser().absolute()
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").expanduser().absolute() / "v3studio"


def cache_limit() -> int:
    """Bytes: V3STUDIO_CACHE_GIGABYTES, or `DEFAULT_GIGABYTES`. StudioError: `storage.cache_size`."""
    named = os.environ.get("V3STUDIO_CACHE_GIGABYTES") or str(DEFAULT_GIGABYTES)
    with suppress(ValueError):
        if 0 < float(named) < math.inf:
            return int(float(named) * 1e9)
    problem = f"V3STUDIO_CACHE_GIGABYTES is '{named}', which is not a number above 0"
    fix = "Set it to the size of the cache in GB, such as 100."
    raise StudioError("storage.cache_size", problem, value=named, fix=fix)


class DiskCache:
    """Objects of stores on this machine's disk; the least recently used go first. Safe for several threads and
    processes; `disk_cache` makes it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._added: int | None = None  # bytes since the last measurement; None: never measured
        self._lock = threading.Lock()

    def path(self, key: str) -> Path:
        """The file in which the object of this key (hexadecimal) is kept."""
        return self.folder / "objects" / key[:2] / key

    def added(self, count: int) -> None:
        """Bytes were added; removes the least recently used objects if there are too many."""
        limit = cache_limit()
        with self._lock:
            if self._added is not None:
                self._added += count
                if self._added < limit * _CHECK_SHARE:
                    return
            self._added = 0
        with locked(self.folder / "evict.lock", wait=False) as mine:
            if mine:
                self._evict(limit)

    def _evict(self, limit: int) -> None:
        files: list[tuple[float, int, Path]] = []
        with suppress(FileNotFoundError):  # someone deletes the cache meanwhile
            for path in self.folder.glob("objects/*/*"):
                with suppress(FileNotFoundError):
                    state = path.stat()
                    files.append((state.st_mtime, state.st_blocks * 512, path))
        total = sum(size for _, size, _ in files)
        if total <= limit:
            return
        for _, size, path in sorted(files):
            path.unlink(missing_ok=True)
            total -= size
            if total <= limit * _KEEP:
                return


@cache
def disk_cache(folder: Path) -> DiskCache:
    """The `DiskCache` of a folder: one per process, so that all its objects count towards the same measurement."""
    return DiskCache(folder)


@contextmanager
def locked(path: Path, wait: bool = True) -> Iterator[bool]:
    """Lock a file for this thread and process; yields whether it is locked, which is always so if `wait`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as file:
        try:
            lock(file, wait=wait)
        except BlockingIOError:
            yield False
            return
        yield True
