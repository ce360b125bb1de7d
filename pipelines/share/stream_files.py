"""A stream to share: its manifest as it is, its files, checked."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.share.results import PageText
from pipelines.takes.locate_stream import stream_place
from studio.stream.manifest import FileEntry, Manifest

if TYPE_CHECKING:
    from studio.stream import StreamReader


@dataclass(frozen=True)
class StreamToShare:
    """An opened stream.

    Attributes:
        reader: of its frames, in the best rendition.
        name: of the take or the stream, the title of last resort.
    """

    reader: StreamReader
    name: str

    @property
    def manifest(self) -> Manifest:
        """Of the stream."""
        return self.reader.manifest

    @property
    def manifest_bytes(self) -> bytes:
        """As they are stored; a copy must not change them."""
        return self.reader.manifest_bytes

    @cached_property
    def files(self) -> tuple[FileEntry, ...]:
        """All files besides the manifest, of all renditions."""
        return self.reader.files

    @property
    def total_bytes(self) -> int:
        """Bytes of all files and the manifest."""
        return len(self.manifest_bytes) + sum(file.bytes for file in self.files)

    def read(self, file: FileEntry) -> bytes:
        """A file, verified.

        Raises:
            StudioError: it is missing, has another size (`stream.wrong_size`) or SHA-256 (`stream.wrong_checksum`).
        """
        return self.reader.checked(file)

    def text(self, given: PageText) -> PageText:
        """`given`, completed by what the stream says of itself, and the name for a missing title."""
        own = {
            key: value.strip()
            for key in ("title", "credits", "license", "description")
            if isinstance(value := self.manifest.metadata.get(key), str)
        }
        return replace(
            given,
            title=given.title or own.get("title") or self.name,
            credits=own.get("credits") if given.credits is None else given.credits,
            license=own.get("license") if given.license is None else given.license,
            description=own.get("description") if given.description is None else given.description,
        ).encodable()


@contextmanager
def stream_to_share(text: str) -> Iterator[StreamToShare]:
    """Open what a user names: the folder of a take or of a stream, or a URL.

    Raises:
        StudioError: no such folder (`stream.not_found`), a take without a stream (`take.no_stream`), no or a bad
            manifest.
    """
    from studio.stream import StreamReader

    place = stream_place(text)
    with StreamReader.open(place) as reader:
        yield StreamToShare(reader, _name(place))


def name_of(folder: Path) -> str:
    """Name of a stream's folder, or of its file without the extension; of a take's stream, the take's."""
    folder = folder.absolute()
    if folder.is_file():
        return folder.stem
    in_take = folder.name == "stream" and (folder.parent / "take.json").is_file()
    return folder.parent.name if in_take else folder.name


def _name(place: Path | str) -> str:
    if isinstance(place, Path):
        return name_of(place)
    from urllib.parse import unquote, urlsplit

    address = urlsplit(place)
    parts = [unquote(part) for part in address.path.split("/") if part]
    return (parts[-1] if parts else "") or address.netloc
