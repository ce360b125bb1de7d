"""Atomic outputs: files and folders are written under a temporary name, then renamed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from studio.errors import StudioError


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")


def _check_target(path: Path, what: str) -> None:
    if not path.parent.is_dir():
        raise StudioError(
            "export.no_parent_folder", f"the folder {path.parent} does not exist", file=path, fix="Create it first."
        )
    if os.path.lexists(path):
        raise StudioError(
            "export.already_exists", f"the {what} already exists", file=path, fix="Delete it, or choose another name."
        )


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A temporary folder that becomes `path` when the block succeeds, and is deleted otherwise.

    Raises:
        StudioError: `path` exists (export.already_exists), its parent folder does not (export.no_parent_folder), or
            writing fails (export.write_failed).
    """
    path = path.absolute()
    _check_target(path, "folder")
    temporary = _temporary(path)
    try:
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir()
        yield temporary
        os.rename(temporary, path)
    except OSError as error:
        raise StudioError("export.write_failed", f"cannot be written ({error.strerror or error})", file=path) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """As `new_folder`, for a file. The temporary name has the same extension, since writers select the format by it."""
    path = path.absolute()
    _check_target(path, "file")
    temporary = _temporary(path)
    try:
        yield temporary
        os.rename(temporary, path)
    except OSError as error:
        raise StudioError("export.write_failed", f"cannot be written ({error.strerror or error})", file=path) from None
    finally:
        temporary.unlink(missing_ok=True)
