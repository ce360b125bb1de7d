"""Exports appear whole or not at all: written under another name and renamed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from studio.errors import StudioError


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")


def _refuse(path: Path, what: str) -> None:
    if not path.parent.is_dir():
        raise StudioError(f"{path}: there is no folder {path.parent} to write it to; make it first.")
    if os.path.lexists(path):
        raise StudioError(f"{path}: this exists already; delete it, or give another name for the {what}.")


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A folder to fill; becomes `path` when the block ends well and is deleted when it does not.

    Raises:
        StudioError: `path` exists, or its parent does not; or the disk is full or may not be written to.
    """
    path = path.absolute()
    _refuse(path, "folder")
    temporary = _temporary(path)
    try:
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir()
        yield temporary
        os.rename(temporary, path)
    except OSError as error:
        raise StudioError(f"{path}: cannot be written ({error.strerror or error}).") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """The same for a file; its temporary name has the same ending, which writers choose the format by."""
    path = path.absolute()
    _refuse(path, "file")
    temporary = _temporary(path)
    try:
        yield temporary
        os.rename(temporary, path)
    except OSError as error:
        raise StudioError(f"{path}: cannot be written ({error.strerror or error}).") from None
    finally:
        temporary.unlink(missing_ok=True)
