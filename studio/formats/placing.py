"""Atomic outputs: files and folders are written under a temporary name, then renamed."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from v3studio.studio.atomic_files import atomic_path, remove, remove_leftovers
from v3studio.studio.errors import StudioError, reason_of


def _check_target(path: Path, what: str) -> None:
    if os.path.lexists(path):
        problem = f"the {what} already exists"
        raise StudioError("export.already_exists", problem, file=path, fix="Delete it, or choose another name.")


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A folder that becomes `path` when the block succeeds, else is deleted. Raises StudioError: `export.*`."""
    with _new(path, "folder") as temporary:
        remove(temporary)  # of a killed process with the same number
        temporary.mkdir()
        yield temporary


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Place a file as `new_folder` places a folder. The temporary name has the file's extension, by which writers
    choose a format."""
    with _new(path, "file") as temporary:
        yield temporary


@contextmanager
def _new(path: Path, what: str) -> Iterator[Path]:
    path = path.absolute()
    _check_target(path, what)
    remove_leftovers(path.parent, path)
    try:
        with atomic_path(path) as temporary:
            yield temporary
            _check_target(path, what)  # another program may have written there meanwhile
    except (FileExistsError, NotADirectoryError):
        problem = "cannot be written: a part of the path is a file, not a folder"
        raise StudioError("export.write_failed", problem, file=path, fix="Choose another folder.") from None
    except OSError as error:
        problem, fix = f"cannot be written ({reason_of(error)})", "Check the path and its permissions."
        raise StudioError("export.write_failed", problem, file=path, fix=fix) from None
