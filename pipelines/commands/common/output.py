"""`--overwrite`: an output that exists is replaced only with this option, and only if it is of the same kind."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from studio.errors import StudioError


def add_overwrite(parser: argparse.ArgumentParser, text: str = "replace the output if it exists") -> None:
    """Add the option."""
    parser.add_argument("--overwrite", action="store_true", help=text)


@contextmanager
def replacing(out: Path, overwrite: bool, ours: Callable[[Path], bool]) -> Iterator[None]:
    """The block writes `out`, which does not exist then. What was there is restored if it fails.

    Args:
        out: file or folder.
        overwrite: whether `--overwrite` was given.
        ours: whether an existing output is of the kind that the block writes. Anything else is never deleted.

    Raises:
        StudioError: `out` exists and `overwrite` is false (`output.exists`), or it is something else
            (`output.not_ours`).
    """
    out = out.absolute()
    if not os.path.lexists(out):
        yield
        return
    if not overwrite:
        raise StudioError(
            "output.exists", "already exists", file=out, fix="Choose another name, or add --overwrite to replace it."
        )
    if out.is_symlink() or not ours(out):
        raise StudioError(
            "output.not_ours",
            "is not an earlier output of this command, so --overwrite does not delete it",
            file=out,
            fix="Choose another name, or delete it.",
        )
    from pipelines.takes.atomic_files import disk_errors, remove

    old = out.with_name(f".{out.name}.{os.getpid()}.old")
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
