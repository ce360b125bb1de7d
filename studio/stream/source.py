"""Where a stream's files come from. A folder now; whatever else implements `Source` later."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from studio.errors import StudioError


class Source(Protocol):
    """Gives the files of one stream by their path relative to it. Thread safe."""

    @property
    def name(self) -> str:
        """What messages call the stream: a folder or an address."""
        ...

    def read(self, path: str, limit: int) -> bytes:
        """The whole file; at most `limit` bytes are ever held.

        Raises:
            StudioError: the file is missing, unreadable or longer than `limit`.
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
