"""Outputs that exist: replaced only when asked, and only if they are of the same kind."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from v3studio.studio.errors import StudioError


def check_output(out: Path, overwrite: bool, ours: Callable[[Path], bool]) -> None:
    """Check that `out` may be written: an empty folder always, what exists if `overwrite` and `ours`: it is of the kind
    that would be written. `ours` may raise a StudioError that says more."""
    empty = out.is_dir() and not out.is_symlink() and not any(out.iterdir())
    if empty or not os.path.lexists(out):
        return
    if out.is_symlink() or not ours(out):
        fix = "Choose another name, or delete it."
        raise StudioError("output.not_ours", "exists and is not an earlier output of this command", file=out, fix=fix)
    if not overwrite:
        fix = "Choose another name, or add --overwrite to replace it."
        raise StudioError("output.exists", "already exists", file=out, fix=fix)


@contextmanager
def replacing(out: Path, overwrite: bool, ours: Callable[[Path], bool]) -> Iterator[None]:
    """The block writes `out`, which does not exist then; arguments as for `check_output`. What was there is restored if
    it fails, and, if the process is killed, by the next call."""
    from v3studio.pipelines.takes.files.disk_errors import disk_errors
    from v3studio.studio.atomic_files import remove, restore_old, temporary_path

    out = out.absolute()
    with disk_errors(out.parent):
        restore_old(out)
    check_output(out, overwrite, ours)
    if not os.path.lexists(out):
        yield
        return
    old = temporary_path(out, ".old")
    with disk_errors(out.parent):
        os.rename(out, old)
    try:
        yield
    except BaseException as error:
        if isinstance(error, StudioError) and error.code == "export.already_exists":  # by another program, meanwhile
            remove(old)
            raise
        remove(out)
        os.rename(old, out)
        raise
    remove(old)
