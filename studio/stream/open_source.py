"""The source of the files of a stream: a folder or a web server, chosen by what the place looks like."""

from __future__ import annotations

from pathlib import Path

from studio.errors import StudioError
from studio.stream.http_source import HttpSource
from studio.stream.source import FolderSource, Source, is_address


def open_source(place: Path | str | Source) -> Source:
    """The source at a folder or an http(s) address; another source is given back as it is.

    Raises:
        StudioError: there is no such folder, or an address of another kind.
    """
    if not isinstance(place, str | Path):
        return place
    if isinstance(place, str) and is_address(place):
        return HttpSource(place)
    if isinstance(place, str) and "://" in place:
        raise StudioError(f"{place}: streams are read from folders and from http:// or https:// addresses only.")
    if not Path(place).is_dir():
        raise StudioError(f"{place}: there is no such folder; give the folder of a baked stream.")
    return FolderSource(place)
