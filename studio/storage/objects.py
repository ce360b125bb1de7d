"""Objects of a store on this machine's disk, in blocks that are fetched when they are first read.

Pointer files, as in Git LFS, stand for them: small files in a mirror (`studio.storage.mirror`). Code that reads footage
asks `cached_object` first; other code finds a file that is no image and no video.

A cached file is sparse: the object's bytes, followed by one byte for each block, which is 1 if the block is there. A
block is marked only once its bytes are on the disk. The file is locked while blocks are fetched, so that the processes
of a machine fetch each block once.
"""

import errno
import fcntl
import hashlib
import json
import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path

from v3studio.studio.atomic_files import atomic_path, lock
from v3studio.studio.errors import StudioError, show_as
from v3studio.studio.storage.cache import disk_cache
from v3studio.studio.storage.store import Store

BLOCK = 1 << 20  # bytes that are fetched at once at least: a few frames of a video
_MOST_AHEAD = 8  # blocks that are fetched at once at most while a file is read from front to back

_TOUCH_SECONDS = 60.0

_MAGIC = b"v3studio pointer 1\n"
_MOST_BYTES = 8192
_COPIED_AT_ONCE = 16 << 20


@dataclass(frozen=True)
class Pointer:
    """The object of a store for which a file stands, with its size in bytes and a tag that changes with its content."""

    store: str
    path: str
    size: int
    tag: str
    cache: str

    @property
    def key(self) -> str:
        """Name in the cache: another content has another key."""
        named = f"{self.store}/{self.path}\0{self.size}\0{self.tag}\0{BLOCK}"
        return hashlib.sha256(named.encode()).hexdigest()[:40]


class CachedObject:
    """An object of `size` bytes, read through the cache. Thread safe. Unless it `fetches`, blocks that are not in the
    cache read as zeros."""

    def __init__(self, pointer: Pointer) -> None:
        self._pointer = pointer
        self._store: Store | None = None
        self._cache = disk_cache(Path(pointer.cache))
        self.size, self.name = pointer.size, f"{pointer.store}/{pointer.path}"
        self.fetches = True
        self._blocks = -(-pointer.size // BLOCK)
        self._position = 0
        self._next, self._ahead = -1, 1  # block after the last fetched one, and how many to fetch if it is next
        self._lock = threading.Lock()
        self._file = self._open()
        self._touched = 0.0

    def read_at(self, start: int, count: int) -> bytes:
        """Up to `count` bytes from `start`; fewer at the end. Raises StudioError: `storage.*`."""
        count = max(0, min(count, self.size - start))
        if not count:
            return b""
        first, last = start // BLOCK, (start + count - 1) // BLOCK
        with self._lock:
            if self.fetches and 0 in self._held(first, last + 1):
                self._fetch(first, last)
            now = time.time()
            if now - self._touched > _TOUCH_SECONDS:
                self._touched = now
                os.utime(self._file)
            return os.pread(self._file, count, start)

    def read(self, count: int = -1) -> bytes:
        data = self.read_at(self._position, self.size if count < 0 else count)
        self._position += len(data)
        return data

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._position = max(0, offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self.size}[whence])
        return self._position

    def tell(self) -> int:
        return self._position

    def close(self) -> None:
        """Close the file; nothing can be read any more."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def __del__(self) -> None:
        if getattr(self, "_file", -1) >= 0:
            self.close()

    def _open(self) -> int:
        path = self._cache.path(self._pointer.key)
        path.parent.mkdir(parents=True, exist_ok=True)
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        length = self.size + self._blocks
        if os.fstat(file).st_size != length:  # new, or a killed process had just made it
            os.ftruncate(file, length)
        return file

    def _held(self, first: int, stop: int) -> bytes:
        return os.pread(self._file, stop - first, self.size + first)

    def _fetch(self, first: int, last: int) -> None:
        locked = lock(self._file)  # another process may be fetching the same blocks: wait for it
        try:
            if first == self._next or (first < self._next <= last):
                self._ahead = min(_MOST_AHEAD, self._ahead * 2)
                last = max(last, min(first + self._ahead, self._blocks) - 1)
            else:
                self._ahead = 1
            held = self._held(first, last + 1)
            for is_held, run in groupby(range(first, last + 1), lambda block: held[block - first]):
                if not is_held:
                    blocks = list(run)
                    self._fetch_blocks(blocks[0], blocks[-1] + 1)
            self._next = last + 1
        finally:
            if locked:
                fcntl.flock(self._file, fcntl.LOCK_UN)

    def _fetch_blocks(self, first: int, stop: int) -> None:
        if self._store is None:
            self._store = Store(self._pointer.store)
        begin, end = first * BLOCK, min(stop * BLOCK, self.size)
        data = self._store.read(self._pointer.path, begin, end)
        with _room(self._cache.folder):
            written = 0
            while written < len(data):
                written += os.pwrite(self._file, memoryview(data)[written:], begin + written)
            os.fdatasync(self._file)
            os.pwrite(self._file, b"\1" * (stop - first), self.size + first)
            self._cache.added(len(data))


@contextmanager
def _room(folder: Path) -> Iterator[None]:
    """Say so if the disk of the cache is full."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        problem = "the disk is full, so that footage cannot be fetched"
        fix = "Free some space, lower V3STUDIO_CACHE_GIGABYTES, or set V3STUDIO_CACHE to a folder on another disk."
        raise StudioError("storage.cache_full", problem, file=folder, fix=fix) from None


def pointer_bytes(pointer: Pointer) -> bytes:
    """Content of a pointer file."""
    return _MAGIC + json.dumps(asdict(pointer)).encode() + b"\n"


def read_pointer(path: Path) -> Pointer | None:
    """The object that a file stands for; None if it is an ordinary file, or missing."""
    try:
        if os.stat(path).st_size > _MOST_BYTES:
            return None
        with open(path, "rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                return None
            return Pointer(**json.loads(file.read()))
    except (OSError, ValueError, TypeError):
        return None


def cached_object(path: Path) -> CachedObject | None:
    """The object that a file stands for; None if it is an ordinary file. Raises StudioError: `storage.*`."""
    pointer = read_pointer(path)
    return None if pointer is None else CachedObject(pointer)


def whole_files(paths: Sequence[Path]) -> list[Path]:
    """Ordinary files with the contents of `paths`, for what only reads files; StudioError: `storage.*`.

    Objects of a store are copied to the machine's cache: together in one folder and with their names, because a model
    finds its external weights by name. Another version of an object has another folder. The copies are not counted as
    part of the cache. Other paths, also of missing files, are returned as they are.
    """
    pointers = {path: pointer for path in paths if (pointer := read_pointer(path)) is not None}
    if not pointers:
        return list(paths)
    first = next(iter(pointers.values()))
    key = hashlib.sha256("".join(f"{path.name}\0{pointer.key}\0" for path, pointer in pointers.items()).encode())
    folder = Path(first.cache) / "whole" / key.hexdigest()[:40]
    show_as(f"{folder}/", f"{first.store}/{first.path}"[: -len(first.path.rpartition("/")[2])])
    with _room(Path(first.cache)):
        for path, pointer in pointers.items():
            _copy(pointer, folder / path.name)
    return [folder / path.name if path in pointers else path for path in paths]


def _copy(pointer: Pointer, path: Path) -> None:
    if path.is_file() and path.stat().st_size == pointer.size:
        return
    stored = CachedObject(pointer)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        while part := stored.read(_COPIED_AT_ONCE):
            file.write(part)
