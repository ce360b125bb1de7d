"""The groups of a stream: those in the manifest, and those in pages, which are read when needed."""

from bisect import bisect_right
from collections.abc import Callable
from contextlib import AbstractContextManager
from itertools import accumulate

from v3studio.studio.errors import StudioError
from v3studio.studio.memory_cache import MemoryCache
from v3studio.studio.stream.manifest import FileEntry, GroupEntry, Manifest, PageEntry
from v3studio.studio.stream.manifest_file import parse_page
from v3studio.studio.stream.sources.source import Source

_KEPT_PAGES = 16


class GroupIndex:
    """All groups of a stream. Thread safe. `reading`: a context around each read of a page, to change errors."""

    def __init__(self, manifest: Manifest, source: Source, reading: Callable[[], AbstractContextManager[None]]) -> None:
        self.manifest, self._reading = manifest, reading
        self.starts = tuple(accumulate(manifest.frame_counts[:-1], initial=0))
        self._source = source
        counts = [len(manifest.groups), *(len(page.frames) for page in manifest.pages)]
        self._page_starts = list(accumulate(counts, initial=0))[:-1]  # first group of the manifest and of each page
        self._pages: MemoryCache[int, tuple[GroupEntry, ...]] = MemoryCache(_KEPT_PAGES)

    def __len__(self) -> int:
        return len(self.starts)

    def group_of(self, frame: int) -> int:
        """Number of the group that contains a frame; reads no page. Raises StudioError if there is no such frame."""
        if not 0 <= frame < self.manifest.frame_count:
            problem = f"no frame {frame}; the stream has frames 0 to {self.manifest.frame_count - 1}"
            raise StudioError("stream.no_such_frame", problem, value=frame, frame_count=self.manifest.frame_count)
        return bisect_right(self.starts, frame) - 1

    def group(self, number: int) -> GroupEntry:
        """Group `number`, with its page read if needed."""
        place = bisect_right(self._page_starts, number) - 1
        if place == 0:
            return self.manifest.groups[number]
        groups = self._pages.get_or_make(place, self._read)
        return groups[number - self._page_starts[place]]

    def page_of(self, number: int) -> PageEntry | None:
        """The page that has group `number`; None for a group in the manifest itself."""
        place = bisect_right(self._page_starts, number) - 1
        return self.manifest.pages[place - 1] if place else None

    def files(self, number: int) -> tuple[FileEntry, ...]:
        """The files that playing group `number` takes, in the order in which a player needs it: its page, and its own
        files in all renditions."""
        page = self.page_of(number)
        return (*(() if page is None else (page,)), *self.group(number).files)

    def _read(self, place: int) -> tuple[GroupEntry, ...]:
        page, first = self.manifest.pages[place - 1], self._page_starts[place]
        name = f"{self._source.name}/{page.path}"
        with self._reading():
            data = self._source.read(page.path, page.bytes)
            return parse_page(data, page, self.manifest, first, self.starts[first], name)
