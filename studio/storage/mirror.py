"""A local folder that looks like one in a store: camera files as they are, pointer files for images and videos."""

import errno
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from v3studio.studio.atomic_files import write_bytes
from v3studio.studio.errors import StudioError, show_as
from v3studio.studio.storage.cache import cache_folder, cache_limit, disk_cache, locked
from v3studio.studio.storage.objects import Pointer, pointer_bytes, read_pointer
from v3studio.studio.storage.store import Entry, Store

DESCRIBING = frozenset(
    {".json", ".yml", ".yaml", ".xml", ".txt", ".toml", ".npy", ".csv", ".cfg", ".ini", ".inf", ".bin"}
)
"""Extensions of files that describe a capture, such as calibrations. Many readers open them, so they are fetched at
once."""

_LARGEST = 256 << 20  # bytes; larger files are not fetched at once
_PARALLEL = 16


def mirrored(address: str | os.PathLike[str]) -> Path:
    """List a folder of a store (s3://bucket/folder), bring its mirror in the machine's cache up to date, and return it.

    Files that describe the capture are fetched; of images and videos only what is read later, and each part once: see
    `studio.storage.objects`. StudioError: `storage.*`; `storage.empty`: there are no objects at this address;
    `storage.bad_name`: an object that no file can be named after.
    """
    store = Store(address)
    entries = store.list()
    if not entries:
        fix = "Correct the address, or copy the footage there."
        raise StudioError("storage.empty", "there are no objects at this address", file=store.address, fix=fix)
    cache = disk_cache(cache_folder())
    cache_limit()  # an invalid one is reported before anything is fetched
    scheme, _, path = store.address.partition("://")
    root = cache.folder / "mirror" / scheme / path
    show_as(f"{cache.folder / 'mirror' / scheme}/", f"{scheme}://")
    try:
        with locked(cache.folder / "mirror.lock"):
            _update(root, store, entries, str(cache.folder))
    except OSError as error:
        problem = f"the cache cannot be written ({error.strerror})"
        fix = "Set V3STUDIO_CACHE to a folder on a local disk with free space."
        raise StudioError("storage.cache_unwritable", problem, file=cache.folder, fix=fix) from None
    return root


def _update(root: Path, store: Store, entries: dict[str, Entry], cache: str) -> None:
    root.mkdir(parents=True, exist_ok=True)
    _forget(root, set(entries))
    folders = {str(parent) for name in entries for parent in PurePosixPath(name).parents}
    small: list[tuple[Path, Pointer]] = []
    for name, entry in entries.items():
        if any(part in ("", ".", "..") for part in name.split("/")):  # a store allows any name
            continue
        if name in folders:
            if not entry.size:  # some programs mark folders with empty objects
                continue
            raise _bad_name(store, name, f"the object has the name of a folder ({name}/...)")
        path, pointer = root / name, Pointer(store.address, name, entry.size, entry.tag, cache)
        if path.suffix.lower() in DESCRIBING and entry.size <= _LARGEST:
            if read_pointer(_beside(path)) != pointer or not path.is_file():
                small.append((path, pointer))
        elif read_pointer(path) != pointer:
            with _named(store, name):
                write_bytes(path, pointer_bytes(pointer))
    with ThreadPoolExecutor(_PARALLEL, thread_name_prefix="fetch") as pool:
        list(pool.map(lambda fetched: _fetch(store, *fetched), small))


def _fetch(store: Store, path: Path, pointer: Pointer) -> None:
    data = store.read(pointer.path, 0, pointer.size)
    with _named(store, pointer.path):
        write_bytes(path, data)
        write_bytes(_beside(path), pointer_bytes(pointer))


@contextmanager
def _named(store: Store, name: str) -> Iterator[None]:
    """Raise StudioError (storage.bad_name) if the name of an object is too long for a file."""
    try:
        yield
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        raise _bad_name(store, name, "the object's name is too long for a file") from None


def _bad_name(store: Store, name: str, problem: str) -> StudioError:
    fix = "Rename it or move it out of the footage."
    return StudioError("storage.bad_name", problem, file=f"{store.address}/{name}", fix=fix)


def _beside(path: Path) -> Path:
    """The file that says which version of an object a fetched file has. It is hidden, so that it is never taken for
    footage."""
    return path.with_name(f".{path.name}.pointer")


def _forget(root: Path, names: set[str]) -> None:
    """Delete what the store has no more, and leftovers of killed processes; who writes here has locked the mirrors."""
    for folder, _, files in os.walk(root, topdown=False):
        for name in files:
            path = Path(folder, name)
            of = name[1:].removesuffix(".pointer") if name.startswith(".") and name.endswith(".pointer") else name
            if path.with_name(of).relative_to(root).as_posix() not in names:
                with suppress(FileNotFoundError):
                    path.unlink()
        if Path(folder) != root:
            with suppress(OSError):  # not empty
                os.rmdir(folder)
