"""Publishes a stream: copies what is missing to a folder or an object store, the manifest last."""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from v3studio.studio.atomic_files import remove_leftovers, write_bytes
from v3studio.studio.errors import StudioError, reason_of
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.storage import Store
from v3studio.studio.stream.manifest import FILES, MANIFEST_NAME, FileEntry
from v3studio.studio.stream.reader import StreamReader

IMMUTABLE = "public, max-age=31536000, immutable"  # Cache-Control of files that are named by their content
REVALIDATED = "no-cache"  # Cache-Control of the manifest

TYPES = {
    ".json": "application/json",
    ".mp4": "video/mp4",
    ".m4a": "audio/mp4",
    ".bin": "application/octet-stream",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript",
    ".jpg": "image/jpeg",
    ".txt": "text/plain; charset=utf-8",
}
_PARALLEL = 8


@dataclass(frozen=True)
class Published:
    """The result of publishing: files that were copied, their bytes, and files that were there already."""

    copied: int
    bytes: int
    present: int


def publish(
    reader: StreamReader, target: str, progress: ProgressFn = no_progress, beside: Mapping[str, bytes] | None = None
) -> Published:
    """Copy all files of a stream that the target lacks, then its manifest.

    Players see the old stream or the new one, never a mixture: a file never changes under its name, and the manifest is
    replaced last. Files that the new manifest does not need stay, for players that still have the old one.

    Args:
        reader: the stream; files are verified before they are copied.
        target: a folder, or an address in an object store, such as s3://bucket/folder, which needs s3fs.
        progress: called with (files done, files).
        beside: further files by name, such as a page that plays the stream, put there in this order after the
            manifest. `.html` files are revalidated; the others must be named by their content. Not counted.

    Raises:
        StudioError: a damaged file, or the target cannot be written (`publish.failed`, `storage.*`).
    """
    files = reader.files
    try:
        place: _Folder | _Bucket = _Bucket(target) if "://" in target else _Folder(Path(target).expanduser())
        missing = [file for file in files if place.size(file.path) != file.bytes]
        done = len(files) - len(missing)
        progress(done, len(files))

        def copy(file: FileEntry) -> None:
            place.put(file.path, reader.checked(file), IMMUTABLE)

        with ThreadPoolExecutor(_PARALLEL, thread_name_prefix="publish") as pool:
            try:
                for _ in pool.map(copy, missing):
                    done += 1
                    progress(done, len(files))
            except BaseException:
                pool.shutdown(wait=True, cancel_futures=True)
                raise
        place.put(MANIFEST_NAME, reader.manifest_bytes, REVALIDATED)
        for name, data in (beside or {}).items():
            place.put(name, data, REVALIDATED if name.endswith(".html") else IMMUTABLE)
    except OSError as error:
        problem = f"the target cannot be written ({reason_of(error)})"
        fix = "Check the path and the permissions, then publish again: what is there is kept."
        raise StudioError("publish.failed", problem, file=target, fix=fix) from error
    return Published(len(missing), sum(file.bytes for file in missing), len(files) - len(missing))


class _Folder:
    def __init__(self, root: Path) -> None:
        self._root = root
        for folder in (root, root / FILES):
            remove_leftovers(folder)

    def size(self, path: str) -> int | None:
        file = self._root / path
        return file.stat().st_size if file.is_file() else None

    def put(self, path: str, data: bytes, cache: str) -> None:
        write_bytes(self._root / path, data)


class _Bucket:
    def __init__(self, address: str) -> None:
        self._store = Store(address)
        self._present = self._store.list()

    def size(self, path: str) -> int | None:
        return self._present[path].size if path in self._present else None

    def put(self, path: str, data: bytes, cache: str) -> None:
        self._store.write(path, data, TYPES.get(os.path.splitext(path)[1], "application/octet-stream"), cache)
