"""The groups of a stream of version 3: those in the manifest, and those in pages, which are read when needed."""

from __future__ import annotations

import threading
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from itertools import accumulate
from typing import overload

from studio.errors import StudioError
from studio.stream.ladder_manifest import (
    LadderManifest,
    RenditionManifest,
    fixed_files,
    parse_page,
    starts_of,
)
from studio.stream.ladder_models import GroupLadder, PageEntry
from studio.stream.manifest import MANIFEST_NAME, no_such_frame, wrong_total
from studio.stream.manifest_models import GroupEntry
from studio.stream.source import Source

_KEPT_PAGES = 16


class GroupIndex:
    """All groups of a stream. Thread safe.

    Args:
        manifest: the stream's.
        source: has the pages.
        manifest_bytes: size of the manifest's file.

    Attributes:
        manifest: as given.
        starts: first frame of each group.
        reading: makes a context around each read of a page, which may raise other errors instead.
    """

    def __init__(self, manifest: LadderManifest, source: Source, manifest_bytes: int) -> None:
        self.manifest = manifest
        self.reading: Callable[[], AbstractContextManager[None]] = nullcontext
        self.starts = starts_of(manifest)
        self._source = source
        self._manifest_bytes = manifest_bytes
        counts = [len(manifest.groups), *(len(page.frames) for page in manifest.pages)]
        self._page_starts = list(accumulate(counts, initial=0))[:-1]  # first group of the manifest and of each page
        self._pages: OrderedDict[int, tuple[GroupLadder, ...]] = OrderedDict()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self.starts)

    def group_of(self, frame: int) -> int:
        """Number of the group that contains a frame; reads no page. Raises StudioError if there is no such frame."""
        if not 0 <= frame < self.manifest.frame_count:
            raise no_such_frame(frame, self.manifest.frame_count)
        return bisect_right(self.starts, frame) - 1

    def ladder(self, number: int) -> GroupLadder:
        """Group `number`, with its page read if needed.

        Raises:
            StudioError: the page is missing, damaged or does not hold what the manifest promises.
        """
        place = bisect_right(self._page_starts, number) - 1
        if place == 0:
            return self.manifest.groups[number]
        with self._lock:
            kept = self._pages.get(place)
            if kept is not None:
                self._pages.move_to_end(place)
        groups = self._read(place) if kept is None else kept
        return groups[number - self._page_starts[place]]

    def page_of(self, number: int) -> PageEntry | None:
        """The page that has group `number`; None for a group in the manifest itself."""
        place = bisect_right(self._page_starts, number) - 1
        return self.manifest.pages[place - 1] if place else None

    def _read(self, place: int) -> tuple[GroupLadder, ...]:
        page, first = self.manifest.pages[place - 1], self._page_starts[place]
        name = f"{self._source.name}/{page.path}"
        with self.reading():
            data = self._source.read(page.path, page.bytes)
            groups = parse_page(data, page, self.manifest, first, self.starts[first], name)
        with self._lock:
            groups = self._pages.setdefault(place, groups)  # another thread's are the same; keep one set
            while len(self._pages) > _KEPT_PAGES:
                self._pages.popitem(last=False)
        return groups

    def check_total(self, group_bytes: int) -> None:
        """Raises StudioError unless `total_bytes` is right, given the size of all files of all groups, each once."""
        expected = group_bytes + sum(file.bytes for file in fixed_files(self.manifest)) + self._manifest_bytes
        if self.manifest.total_bytes != expected:
            raise wrong_total(self.manifest.total_bytes, expected, f"{self._source.name}/{MANIFEST_NAME}")

    def rendition_number(self, rendition: str | None) -> int:
        """Position of a rendition by id; None is the best. Raises StudioError if there is none with this id."""
        ids = [one.id for one in self.manifest.renditions]
        if rendition is None:
            return 0
        if rendition not in ids:
            raise no_such_rendition(rendition, ids, self._source.name)
        return ids.index(rendition)

    def view(self, rendition: str | None) -> RenditionManifest:
        """The stream in one rendition. Raises StudioError if there is none with this id."""
        number = self.rendition_number(rendition)
        whole, one = self.manifest, self.manifest.renditions[number]
        return RenditionManifest.model_construct(
            version=3,
            profile=whole.profile,
            fps=whole.fps,
            frame_count=whole.frame_count,
            sh_degree=one.sh_degree,
            scan=whole.scan,
            codec=whole.codec,
            bounding_box=whole.bounding_box,
            groups=RenditionGroups(self, number),
            settings=whole.settings,
            metadata=whole.metadata,
            total_bytes=whole.total_bytes,
            manifest_sha256=whole.manifest_sha256,
            rendition=one.id,
            own_bytes=one.bytes + sum(file.bytes for file in fixed_files(whole)) + self._manifest_bytes,
            starts=self.starts,
        )


class RenditionGroups(Sequence[GroupEntry]):
    """The groups of one rendition; an item may be read from the source."""

    def __init__(self, index: GroupIndex, number: int) -> None:
        self._index, self._number = index, number

    def __len__(self) -> int:
        return len(self._index)

    @overload
    def __getitem__(self, at: int) -> GroupEntry: ...

    @overload
    def __getitem__(self, at: slice) -> Sequence[GroupEntry]: ...

    def __getitem__(self, at: int | slice) -> GroupEntry | Sequence[GroupEntry]:
        if isinstance(at, slice):
            return [self[number] for number in range(*at.indices(len(self)))]
        number = at + len(self) if at < 0 else at
        if not 0 <= number < len(self):
            raise IndexError(at)
        return self._index.ladder(number).renditions[self._number]


def no_such_rendition(rendition: str, ids: Sequence[str], stream: str) -> StudioError:
    """The error for an unknown rendition."""
    return StudioError(
        "stream.no_such_rendition",
        f"no rendition {rendition!r}; the stream has {', '.join(ids) or 'only one, without a name'}",
        file=f"{stream}/{MANIFEST_NAME}",
        value=rendition,
        fix="Choose one of them.",
        renditions=list(ids),
    )
