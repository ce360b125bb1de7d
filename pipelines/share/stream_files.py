"""A stream to share: its manifest as it is, its files, checked."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.share.results import PageText
from pipelines.takes.locate_stream import stream_place
from studio.errors import StudioError
from studio.stream.manifest import MANIFEST_NAME, Manifest, parse_manifest
from studio.stream.manifest_models import MAX_MANIFEST_BYTES, FileEntry, Model
from studio.stream.open_source import open_source
from studio.stream.source import BAKE_AGAIN, Source, close_source

if TYPE_CHECKING:
    from studio.stream import StreamReader


@dataclass(frozen=True)
class StreamToShare:
    """An opened stream.

    Attributes:
        source: its files.
        manifest: parsed.
        manifest_bytes: as they are stored; a copy must not change them.
        name: of the take or the stream, the title of last resort.
    """

    source: Source
    manifest: Manifest
    manifest_bytes: bytes
    name: str

    @property
    def files(self) -> list[FileEntry]:
        """All files besides the manifest, in its order. What they are called and where the manifest lists them
        differs between versions."""
        found = {entry.path: entry for entry in _file_entries(self.manifest)}
        return list(found.values())

    @property
    def total_bytes(self) -> int:
        """Bytes of all files and the manifest."""
        return len(self.manifest_bytes) + sum(file.bytes for file in self.files)

    def read(self, file: FileEntry) -> bytes:
        """A file, checked.

        Raises:
            StudioError: it is missing, has another size (`stream.wrong_size`) or SHA-256 (`stream.wrong_checksum`).
        """
        data = self.source.read(file.path, file.bytes)
        name = f"{self.source.name}/{file.path}"
        if len(data) != file.bytes:
            raise StudioError(
                "stream.wrong_size",
                f"the file has {len(data)} bytes, the manifest says {file.bytes}",
                file=name,
                value=len(data),
                fix=BAKE_AGAIN,
                expected=file.bytes,
            )
        if hashlib.sha256(data).hexdigest() != file.sha256:
            raise StudioError("stream.wrong_checksum", "SHA-256 differs from the manifest", file=name, fix=BAKE_AGAIN)
        return data

    def reader(self) -> StreamReader:
        """A reader of its frames; the caller closes it."""
        from studio.stream import StreamReader

        return StreamReader(self.source, self.manifest)

    def text(self, given: PageText) -> PageText:
        """`given`, completed by what the stream says of itself, and the name for a missing title."""
        own = {
            key: value.strip()
            for key in ("title", "credits", "license")
            if isinstance(value := self.manifest.metadata.get(key), str)
        }
        return replace(
            given,
            title=given.title or own.get("title") or self.name,
            credits=own.get("credits") if given.credits is None else given.credits,
            license=own.get("license") if given.license is None else given.license,
        )


@contextmanager
def stream_to_share(text: str) -> Iterator[StreamToShare]:
    """Open what a user names: the folder of a take or of a stream, or a URL.

    Raises:
        StudioError: no such folder (`stream.not_found`), a take without a stream (`take.no_stream`), no or a bad
            manifest.
    """
    place = stream_place(text)
    source = open_source(place)
    try:
        data = source.read(MANIFEST_NAME, MAX_MANIFEST_BYTES)
        yield StreamToShare(source, parse_manifest(data, f"{source.name}/{MANIFEST_NAME}"), data, _name(place))
    finally:
        close_source(source)


def name_of(folder: Path) -> str:
    """Name of a stream's folder; of a take's stream, the take's."""
    folder = folder.absolute()
    in_take = folder.name == "stream" and (folder.parent / "take.json").is_file()
    return folder.parent.name if in_take else folder.name


def _name(place: Path | str) -> str:
    if isinstance(place, Path):
        return name_of(place)
    from urllib.parse import unquote, urlsplit

    address = urlsplit(place)
    parts = [unquote(part) for part in address.path.split("/") if part]
    return (parts[-1] if parts else "") or address.netloc


def _file_entries(value: object) -> Iterator[FileEntry]:
    if isinstance(value, FileEntry):
        yield value
    elif isinstance(value, Model):
        for field in type(value).model_fields:
            yield from _file_entries(getattr(value, field))
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _file_entries(item)
