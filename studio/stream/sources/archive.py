"""Reads a stream in one file: a ZIP archive of stored entries, by ranges (docs/STREAM.md, "One file")."""

import errno
import io
import os
import re
import struct
import zipfile
from bisect import bisect_right
from pathlib import Path

from v3studio.studio.errors import StudioError, reason_of
from v3studio.studio.stream.sources.http import HttpSource
from v3studio.studio.stream.sources.source import Source, damaged, too_long

SUFFIX = ".v3s"
MAX_ENTRIES = 1 << 20
MAX_DIRECTORY_BYTES = 128 << 20
_BLOCK = 1 << 16
"""Bytes at either end that are read at once: the manifest's beginning, and the directory of most archives."""

_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}(/[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}){0,7}")
_LOCAL_HEADER = struct.Struct("<4s5H3L2H")


class FileRanges:
    """A local file that is read in parts. Thread safe. Raises StudioError if it cannot be opened."""

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        try:
            self._file = path.open("rb")
        except OSError as error:
            problem = f"the file cannot be read ({reason_of(error)})"
            raise StudioError("source.file_unreadable", problem, file=path) from None
        self._size = os.fstat(self._file.fileno()).st_size

    def read_at(self, offset: int, count: int) -> tuple[bytes, int]:
        """At most `count` bytes from `offset` on, fewer only at the end, and the file's size. Raises StudioError."""
        try:
            return os.pread(self._file.fileno(), count, offset), self._size
        except (OSError, ValueError) as error:
            problem = f"the file cannot be read ({reason_of(error)})"
            raise StudioError("source.file_unreadable", problem, file=self.name) from None

    def close(self) -> None:
        self._file.close()


class ArchiveSource(Source):
    """The files of a one-file stream, which is a local file, or on a web server that answers range requests. Thread
    safe; opening reads its directory. `close` closes `ranges`, too."""

    def __init__(self, ranges: FileRanges | HttpSource) -> None:
        self._ranges = ranges
        self.name = ranges.name
        if isinstance(ranges, HttpSource):
            self.parallel = ranges.parallel
        try:
            with zipfile.ZipFile(_Seekable(ranges)) as archive:
                entries, directory = archive.infolist(), archive.start_dir
        except (zipfile.BadZipFile, ValueError, struct.error, OverflowError, NotImplementedError) as error:
            raise self._damaged(str(error)) from None
        if len(entries) > MAX_ENTRIES:
            raise self._damaged(f"it has {len(entries)} entries; the maximum is {MAX_ENTRIES}")
        starts = sorted({entry.header_offset for entry in entries})
        self._places: dict[str, tuple[int, int, int]] = {}  # offset, end of everything before the next, size
        for entry in entries:
            if not _NAME.fullmatch(entry.filename) or entry.filename in self._places:
                raise self._damaged(f"it has an entry {entry.filename[:80]!r}")
            if entry.compress_type != zipfile.ZIP_STORED or entry.flag_bits & 1:
                problem = f"the entry {entry.filename} is compressed or encrypted, so that it cannot be read by ranges"
                fix = "Export the stream again, or pack it without compression (zip -0)."
                raise StudioError("source.archive_not_stored", problem, file=ranges.name, value=entry.filename, fix=fix)
            after = bisect_right(starts, entry.header_offset)
            end = starts[after] if after < len(starts) else directory
            if entry.header_offset < 0 or end - entry.header_offset < _LOCAL_HEADER.size + entry.file_size:
                raise self._damaged(f"the entry {entry.filename} overlaps another one")
            self._places[entry.filename] = (entry.header_offset, end, entry.file_size)

    def read(self, path: str, limit: int) -> bytes:
        name = f"{self.name}/{path}"
        place = self._places.get(path)
        if place is None:
            raise damaged("source.file_missing", "the file is missing", name)
        offset, end, size = place
        if size > limit:
            raise too_long(name, limit, size)
        # the local header's extra field may differ from the directory's, so its length is not known yet
        most = min(end - offset, _LOCAL_HEADER.size + len(path.encode()) + 1024 + size)
        block, _ = self._ranges.read_at(offset, most)
        if len(block) < _LOCAL_HEADER.size:
            raise self._damaged(f"the entry {path} is cut")
        signature, *_, name_bytes, extra_bytes = _LOCAL_HEADER.unpack_from(block)
        begin = _LOCAL_HEADER.size + name_bytes + extra_bytes
        if signature != b"PK\3\4" or len(block) < begin + size:
            raise self._damaged(f"the entry {path} is cut")
        return block[begin : begin + size]

    def close(self) -> None:
        self._ranges.close()

    def _damaged(self, problem: str) -> StudioError:
        fix = "Copy or download it again."
        return StudioError(
            "source.archive_damaged", f"not a readable one-file stream ({problem})", file=self._ranges.name, fix=fix
        )


class _Seekable(io.RawIOBase):
    """The file through which `zipfile` reads the directory. It keeps the last block, which has most directories."""

    def __init__(self, ranges: FileRanges | HttpSource) -> None:
        self._ranges = ranges
        self._at = 0
        head, self._size = ranges.read_at(0, 1 if isinstance(ranges, FileRanges) else _BLOCK)
        self._tail_at = max(self._size - _BLOCK, 0)
        whole = self._tail_at == 0 and len(head) == self._size
        self._tail = head if whole else ranges.read_at(self._tail_at, self._size - self._tail_at)[0]

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = 0) -> int:
        target = offset + (0, self._at, self._size)[whence]
        if target < 0:
            raise OSError(errno.EINVAL, "a position before the beginning")  # zipfile expects it
        self._at = target
        return target

    def read(self, count: int = -1) -> bytes:
        rest = max(self._size - self._at, 0)
        count = rest if count < 0 else min(count, rest)
        if count > MAX_DIRECTORY_BYTES:
            raise ValueError(f"a directory of {count} bytes")
        if self._at >= self._tail_at:
            begin = self._at - self._tail_at
            data = self._tail[begin : begin + count]
        else:
            data = self._ranges.read_at(self._at, count)[0] if count else b""
        self._at += len(data)
        return data
