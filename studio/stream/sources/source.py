"""Sources of a stream's files: a folder, or a web server (`studio.stream.sources.http`)."""

import os
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

from v3studio.studio.errors import StudioError, reason_of

BAKE_AGAIN = "Bake the stream again, or copy it again."  # the fix for a file of a stream that is missing or damaged


def damaged(
    code: str, problem: str, file: str | os.PathLike[str] | None, value: Any = None, **fields: Any
) -> StudioError:
    """The error for a file of a stream that is missing or damaged."""
    return StudioError(code, problem, file=file, value=value, fix=BAKE_AGAIN, **fields)


class SourceUnavailable(StudioError):
    """The server does not answer, or not in time. The files on it may well be intact."""


class Source(ABC):
    """Reads the files of one stream by their path relative to it. Thread safe. `name`: the stream in messages, a folder
    or a URL; `parallel`: number of files to read at once, above 1 for a network."""

    name: str
    parallel = 1

    @abstractmethod
    def read(self, path: str, limit: int) -> bytes:
        """The whole file, of at most `limit` bytes. StudioError if it is missing, unreadable or longer;
        SourceUnavailable if the server cannot be reached at present."""

    def read_changed(self, path: str, limit: int) -> bytes | None:
        """Read a file like `read`, or return None if it is the same as when this method last read it."""
        return self.read(path, limit)

    def close(self) -> None:  # noqa: B027 - there may be nothing to abort
        """Abort reads in progress. Later reads from a web source raise StudioError."""


class FolderSource(Source):
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
    subject = "the file" if size is None else f"the file has {size} bytes and"
    return damaged(
        "source.file_too_long", f"{subject} is longer than the expected {limit} bytes", file, size, expected=limit
    )


def is_address(place: object) -> bool:
    """Return whether a string starts with http:// or https://."""
    return isinstance(place, str) and place.lower().startswith(("http://", "https://"))
