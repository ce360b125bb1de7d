"""Publishes a stream: copies what is missing to a folder or an object store, the manifest last."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from studio.atomic_files import remove_leftovers, write_bytes
from studio.errors import Cancelled, StudioError, reason_of
from studio.progress import ProgressFn, no_progress
from studio.stream.manifest import FILES, MANIFEST_NAME, FileEntry
from studio.stream.reader import StreamReader

IMMUTABLE = "public, max-age=31536000, immutable"
"""Cache-Control of files that are named by their content."""

REVALIDATED = "no-cache"
"""Cache-Control of the manifest."""

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
    """What publishing did: files that were copied, their bytes, and files that were there already."""

    copied: int
    bytes: int
    present: int


class _Place(Protocol):
    def size(self, path: str) -> int | None: ...

    def put(self, path: str, data: bytes, cache: str) -> None: ...


def publish(
    reader: StreamReader,
    target: str,
    progress: ProgressFn = no_progress,
    beside: Mapping[str, bytes] | None = None,
) -> Published:
    """Copy all files of a stream that the target lacks, then its manifest.

    Players see the old stream or the new one, never a mixture: a file never changes under its name, and the manifest is
    replaced last. Files that the new manifest does not need stay, for players that still have the old one.

    Args:
        reader: the stream; files are verified before they are copied.
        target: a folder, or a URL that fsspec knows, such as s3://bucket/folder; needs the extra `publish`.
        progress: called with (files done, files).
        beside: further files by name, such as a page that plays the stream, put there in this order after the
            manifest. `.html` files are revalidated; the others must be named by their content. Not counted.

    Raises:
        StudioError: a damaged file, a missing package, or the target cannot be written.
    """
    files = reader.files
    place = _open(target)
    with _Written(target):
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


class _Store:
    """A file system of fsspec."""

    def __init__(self, url: str) -> None:
        from fsspec.core import url_to_fs

        self._files, root = url_to_fs(url)
        self._root = root.rstrip("/")
        protocols = self._files.protocol
        self._keeps_headers = "s3" in ((protocols,) if isinstance(protocols, str) else protocols)
        self._present: dict[str, int] = {}
        try:
            found: dict[str, Any] = self._files.find(self._root, detail=True)
        except FileNotFoundError:
            found = {}
        for name, about in found.items():
            self._present[name.removeprefix(self._root).lstrip("/")] = int(about.get("size") or 0)

    def size(self, path: str) -> int | None:
        return self._present.get(path)

    def put(self, path: str, data: bytes, cache: str) -> None:
        headers = {}
        if self._keeps_headers:
            kind = TYPES.get(os.path.splitext(path)[1], "application/octet-stream")
            headers = {"CacheControl": cache, "ContentType": kind}
        else:
            self._files.makedirs(f"{self._root}/{path}".rpartition("/")[0], exist_ok=True)
        self._files.pipe_file(f"{self._root}/{path}", data, **headers)


def _open(target: str) -> _Place:
    if "://" not in target:
        return _Folder(Path(target).expanduser())
    try:
        return _Store(target)
    except ImportError as error:
        raise StudioError(
            "publish.missing_package",
            f"a package is missing ({error})",
            file=target,
            fix="Install it: pip install 'v3studio[publish]'.",
        ) from None
    except StudioError:
        raise
    except Exception as error:  # each file system raises its own
        raise _failed(target, error) from None


class _Written:
    """Turns what file systems raise into a StudioError."""

    def __init__(self, target: str) -> None:
        self._target = target

    def __enter__(self) -> None: ...

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: object) -> None:
        if isinstance(value, Exception) and not isinstance(value, StudioError | Cancelled):
            raise _failed(self._target, value) from None


def _failed(target: str, error: Exception) -> StudioError:
    if "://" in target:
        # the classes of botocore and others are not imported here
        if "Credential" in type(error).__name__:
            return StudioError(
                "publish.no_credentials",
                f"there are no credentials for this store ({error})",
                file=target,
                fix="For s3://, set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or run `aws configure`.",
            )
        if isinstance(error, FileNotFoundError):
            return StudioError(
                "publish.no_bucket",
                f"there is no such bucket ({error})",
                file=target,
                fix="Create the bucket first, or correct the address.",
            )
        if isinstance(error, PermissionError):
            return StudioError(
                "publish.denied",
                f"the store refuses access ({error})",
                file=target,
                fix="Use credentials that may list and write this bucket.",
            )
    return StudioError(
        "publish.failed",
        f"the target cannot be written ({reason_of(error)})",
        file=target,
        fix="Check the address, the permissions and the network, then publish again: what is there is kept.",
    )
