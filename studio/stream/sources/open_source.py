"""Opens the source of a stream: a folder, a web server, or one file on either."""

from pathlib import Path
from urllib.parse import urlsplit

from v3studio.studio.errors import StudioError
from v3studio.studio.stream.sources.archive import SUFFIX, ArchiveSource, FileRanges
from v3studio.studio.stream.sources.http import HttpSource
from v3studio.studio.stream.sources.source import FolderSource, Source, is_address


def open_source(place: Path | str | Source) -> Source:
    """The source for a folder, a file (`.v3s`) or an http(s) URL of either; a `Source` is returned as is."""
    if not isinstance(place, str | Path):
        return place
    if isinstance(place, str) and is_address(place):
        if urlsplit(place).path.lower().endswith(SUFFIX):
            return _archive(HttpSource(place))
        return HttpSource(place)
    if isinstance(place, str) and "://" in place:
        problem = "streams are read from folders and from http:// or https:// URLs only"
        raise StudioError("source.unsupported_url", problem, file=place)
    if Path(place).is_file():
        return _archive(FileRanges(Path(place)))
    if not Path(place).is_dir():
        raise StudioError("source.not_found", "no such folder", file=place, fix="Specify the folder of a baked stream.")
    return FolderSource(place)


def _archive(ranges: FileRanges | HttpSource) -> Source:
    try:
        return ArchiveSource(ranges)
    except BaseException:
        ranges.close()
        raise
