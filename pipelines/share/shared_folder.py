"""A folder that `share` writes: it takes the place of an earlier share when it is complete, and of nothing else."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from v3studio.pipelines.outputs import replacing
from v3studio.pipelines.version import program_version
from v3studio.studio.atomic_files import remove, remove_leftovers, restore_old, temporary_path
from v3studio.studio.bounded_files import parse_json
from v3studio.studio.errors import StudioError
from v3studio.studio.stream.manifest import MANIFEST_NAME

if TYPE_CHECKING:
    from v3studio.studio.stream import StreamReader

RECORD_NAME = "share.json"  # lists what a shared folder consists of, so that it can be replaced, and nothing else

RECORD_FORMAT, RECORD_VERSION = "v3studio-share", 1


class SharedFolder:
    """Files of a share. `written`: bytes of each file, by its path relative to the folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.written: dict[str, int] = {}

    def write(self, name: str, data: bytes) -> None:
        """Write a file, and the folders that it is in."""
        target = self._folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data)
        self.written[name] = len(data)

    def write_stream(
        self, place: str, reader: StreamReader, progress: Callable[[int, int], object] = lambda done, total: None
    ) -> None:
        """Copy a stream to a folder named `place`; `progress` is called with files done and files."""
        for done, file in enumerate(reader.files):
            progress(done, len(reader.files))
            self.write(f"{place}/{file.path}", reader.checked(file))
        self.write(f"{place}/{MANIFEST_NAME}", reader.manifest_bytes)


@contextmanager
def shared_folder(out: Path, title: str | None) -> Iterator[SharedFolder]:
    """A folder beside `out` that takes its place when the block succeeds, and is deleted otherwise. StudioError
    (`output.not_ours`) also if somebody has written there meanwhile."""
    new = temporary_path(out)
    restore_old(out)
    remove_leftovers(out.parent, out)
    remove(new)
    new.mkdir(parents=True)
    try:
        files = SharedFolder(new)
        yield files
        record = {
            "format": RECORD_FORMAT,
            "version": RECORD_VERSION,
            "program": f"v3studio {program_version()}",
            "title": title,
            "files": [{"path": name, "bytes": size} for name, size in sorted(files.written.items())],
        }
        files.write(RECORD_NAME, (json.dumps(record, indent=1, ensure_ascii=False) + "\n").encode())
        with replacing(out, True, is_shared_folder):
            os.rename(new, out)
    finally:
        remove(new)


def is_shared_folder(out: Path) -> bool:
    try:
        record = parse_json((out / RECORD_NAME).read_bytes())
        if record["format"] != RECORD_FORMAT:
            return False
        listed = {str(file["path"]) for file in record["files"]}
    except (OSError, ValueError, KeyError, TypeError):
        return False
    present = {path.relative_to(out).as_posix() for path in out.rglob("*") if not path.is_dir() or path.is_symlink()}
    strange = sorted(present - listed - {RECORD_NAME})
    if strange:
        problem = f"is an earlier share, but holds files that are not part of it, {strange[0]} first"
        fix = "Move them away, or choose another folder."
        raise StudioError("output.not_ours", problem, file=out, value=strange[0], fix=fix)
    return True
