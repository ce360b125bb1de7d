"""Writes a stream into one file: a ZIP archive of stored entries (docs/STREAM.md, "One file")."""

import zipfile
from collections.abc import Iterator
from pathlib import Path

from studio.progress import ProgressFn, no_progress
from studio.stream.manifest import MANIFEST_NAME, FileEntry
from studio.stream.reader import StreamReader

_DATE = (1980, 1, 1, 0, 0, 0)  # equal streams give equal archives


def write_archive(reader: StreamReader, out: Path, progress: ProgressFn = no_progress) -> int:
    """Write a stream with all its renditions, verified, into the file `out`, which is replaced; its size in bytes."""
    written = {MANIFEST_NAME}
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:

        def add(name: str, data: bytes) -> None:
            entry = zipfile.ZipInfo(name, _DATE)
            entry.create_system = 3  # the same on all systems
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data)

        add(MANIFEST_NAME, reader.manifest_bytes)
        for number, files in enumerate(_files_by_group(reader)):
            for file in files:
                if file.path not in written:
                    written.add(file.path)
                    add(file.path, reader.checked(file))
            progress(number + 1, len(reader.index))
    return out.stat().st_size


def _files_by_group(reader: StreamReader) -> Iterator[tuple[FileEntry, ...]]:
    """In the order in which a player needs them: per group its page, then the files of all renditions; sound first."""
    index, audio = reader.index, reader.audio
    for number in range(len(index)):
        page = index.page_of(number)
        first = (*((audio,) if audio is not None and number == 0 else ()), *((page,) if page is not None else ()))
        yield (*first, *index.group(number).files)
