"""Opens the source of a stream: a folder or a web server."""

from __future__ import annotations

from pathlib import Path

from studio.errors import StudioError
from studio.stream.http_source import HttpSource
from studio.stream.source import FolderSource, Source, is_address


def open_source(place: Path | str | Source) -> Source:
    """The source for a folder or an http(s) URL; a `Source` is returned as is.

    Raises:
        StudioError: the folder does not exist, or the URL has another scheme.
    """
    if not isinstance(place, str | Path):
        return place
    if isinstance(place, str) and is_address(place):
        return HttpSource(place)
    if isinstance(place, str) and "://" in place:
        raise StudioError(
            "source.unsupported_url",
            "streams are read from folders and from http:// or https:// URLs only",
            file=place,
        )
    if not Path(place).is_dir():
        raise StudioError("source.not_found", "no such folder", file=place, fix="Specify the folder of a baked stream.")
    return FolderSource(place)
