"""Where a stream's files come from: a folder, or a web server (`studio.stream.http_source`)."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Protocol

from studio.errors import StudioError

_WEB = ("http://", "https://")


class SourceUnavailable(StudioError):
    """The server itself does not answer, or not in time: what lies there may well be intact."""


class Source(Protocol):
    """Gives the files of one stream by their path relative to it. Thread safe.

    A source may have two further members: `parallel`, an integer, how many files are best read at once (1 where it
    has none), and `close()`, which ends reads under way.
    """

    @property
    def name(self) -> str:
        """What messages call the stream: a folder or an address."""
        ...

    def read(self, path: str, limit: int) -> bytes:
        """The whole file; at most `limit` bytes are ever held.

        Raises:
            StudioError: the file is missing, unreadable or longer than `limit`.
            SourceUnavailable: nothing can be read at present.
        """
        ...


class FolderSource:
    """A stream in a folder. Links that lead out of it are not followed."""

    def __init__(self, root: Path | str) -> None:
        self._root = Path(root).resolve()

    @property
    def name(self) -> str:
        """The folder's path."""
        return str(self._root)

    def read(self, path: str, limit: int) -> bytes:
        """See `Source.read`."""
        file = self._root / path
        try:
            if not file.resolve().is_relative_to(self._root):
                raise StudioError(f"{file}: this lies outside the stream's folder; the stream is not to be trusted.")
            with file.open("rb") as handle:
                data = handle.read(limit + 1)
        except FileNotFoundError:
            raise StudioError(f"{file}: the file is missing; bake or fetch the stream again.") from None
        except (OSError, ValueError, RuntimeError) as error:
            raise StudioError(f"{file}: cannot be read ({error}).") from None
        if len(data) > limit:
            raise StudioError(f"{file}: the file is longer than {limit} bytes; bake or fetch the stream again.")
        return data


def is_address(place: object) -> bool:
    """True for text that begins with http:// or https://."""
    return isinstance(place, str) and place.lower().startswith(_WEB)


def close_source(source: Source) -> None:
    """End what the source has under way, where it has anything; reading from it afterwards raises StudioError."""
    close = getattr(source, "close", None)
    if close is not None:
        close()


def read_files(source: Source, wanted: Sequence[tuple[str, int]]) -> dict[str, bytes]:
    """Several files, (path, limit) each, as many at once as the source likes.

    Over a network most of a small file's time is waiting, so a group's files are asked for side by side.

    Raises:
        StudioError: as `Source.read`, of the first file that fails.
    """
    parallel = min(int(getattr(source, "parallel", 1)), len(wanted))
    if parallel <= 1:
        return {path: source.read(path, limit) for path, limit in wanted}
    pool = ThreadPoolExecutor(parallel, thread_name_prefix="fetch")
    try:
        reading = [pool.submit(source.read, path, limit) for path, limit in wanted]
        return {path: future.result() for (path, _), future in zip(wanted, reading, strict=True)}
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # after an error nobody waits for the others
