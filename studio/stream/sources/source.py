"""Sources of a stream's files: a folder, or a web server (`studio.stream.sources.http`)."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Protocol

from studio.errors import StudioError, reason_of

BAKE_AGAIN = "Bake the stream again, or copy it again."  # the fix for a file of a stream that is missing or damaged

_WEB = ("http://", "https://")


def damaged(
    code: str, problem: str, file: str | os.PathLike[str] | None, value: Any = None, **fields: Any
) -> StudioError:
    """The error for a file of a stream that is missing or damaged."""
    return StudioError(code, problem, file=file, value=value, fix=BAKE_AGAIN, **fields)


class SourceUnavailable(StudioError):
    """The server does not answer, or not in time. The files on it may well be intact."""


class Source(Protocol):
    """Reads the files of one stream by their path relative to it. Thread safe.

    Three members are optional: `parallel`, the number of files to read at once (1 if missing), `close()`, which aborts
    reads in progress, and `read_changed(path, limit)`, which returns None if the file is the same as when it last read
    it.
    """

    @property
    def name(self) -> str:
        """The stream in messages: a folder or a URL."""

    def read(self, path: str, limit: int) -> bytes:
        """The whole file, of at most `limit` bytes. StudioError if it is missing, unreadable or longer;
        SourceUnavailable if the server cannot be reached at present."""


class FolderSource:
    """A stream in a folder. Symbolic links out of the folder are refused."""

    def __init__(self, root: Path | str) -> None:
        self._root = Path(root).resolve()
        self.name = str(self._root)

    def read(self, path: str, limit: int) -> bytes:
        file = self._root / path
        try:
            if not file.resolve().is_relative_to(self._root):
                problem = "this file is outside the stream's folder"
                fix = "Do not trust this stream; get it from its author again."
                raise StudioError("source.outside_folder", problem, file=file, fix=fix)
            with file.open("rb") as handle:
                data = handle.read(limit + 1)
        except FileNotFoundError:
            raise damaged("source.file_missing", "the file is missing", file) from None
        except (OSError, ValueError, RuntimeError) as error:
            problem = f"the file cannot be read ({reason_of(error)})"
            raise damaged("source.file_unreadable", problem, file) from None
        if len(data) > limit:
            raise too_long(file, limit)
        return data


def too_long(file: str | os.PathLike[str], limit: int, size: int | None = None) -> StudioError:
    """The error for a file with more bytes than the manifest promises; `size` where it is known."""
    found = "the file" if size is None else f"the file has {size} bytes and"
    return damaged(
        "source.file_too_long", f"{found} is longer than the expected {limit} bytes", file, size, expected=limit
    )


def is_address(place: object) -> bool:
    """True for a string that starts with http:// or https://."""
    return isinstance(place, str) and place.lower().startswith(_WEB)


def close_source(source: Source) -> None:
    """Abort reads in progress. Later reads from a web source raise StudioError."""
    close = getattr(source, "close", None)
    if close is not None:
        close()


def read_files(source: Source, wanted: Sequence[tuple[str, int]]) -> dict[str, bytes]:
    """Content by path of several files, given as (path, limit); StudioError as `Source.read`, for the first that fails.
    Reads `source.parallel` files at once: over a network, most of the time of a small file is latency."""
    parallel = min(int(getattr(source, "parallel", 1)), len(wanted))
    if parallel <= 1:
        return {path: source.read(path, limit) for path, limit in wanted}
    pool = ThreadPoolExecutor(parallel, thread_name_prefix="fetch")
    try:
        reading = [pool.submit(source.read, path, limit) for path, limit in wanted]
        return {path: future.result() for (path, _), future in zip(wanted, reading, strict=True)}
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # after an error, do not wait for the other files
