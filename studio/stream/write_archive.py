"""Writes a stream into one file: a ZIP archive of stored entries (docs/STREAM.md, "One file")."""

import zipfile
from pathlib import Path

from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.stream.manifest import MANIFEST_NAME
from v3studio.studio.stream.reader import StreamReader

_DATE = (1980, 1, 1, 0, 0, 0)  # equal streams give equal archives


def write_archive(reader: StreamReader, out: Path, progress: ProgressFn = no_progress) -> int:
    """Write a stream with all its renditions, verified, into the file `out`, which is replaced; its size in bytes."""
    files = reader.files
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:

        def add(name: str, data: bytes) -> None:
            entry = zipfile.ZipInfo(name, _DATE)
            entry.create_system = 3  # the same on all systems
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data)

        add(MANIFEST_NAME, reader.manifest_bytes)
        for number, file in enumerate(files):
            add(file.path, reader.checked(file))
            progress(number + 1, len(files))
    return out.stat().st_size
