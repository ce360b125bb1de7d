"""Errors of the disk as StudioError."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from v3studio.studio.atomic_files import PARTIAL
from v3studio.studio.errors import StudioError

_DISK_FAILED = (errno.EIO, errno.ESTALE, errno.EREMOTEIO)
_DISK_GONE = (errno.ENODEV, errno.ENXIO, errno.ETIMEDOUT, errno.EHOSTDOWN)
"""Sockets and other devices fail with these numbers too, but their errors name no file."""


@contextmanager
def disk_errors(folder: Path) -> Iterator[None]:
    """Turn what a disk does to any program inside the block into a StudioError: it is full, fails, or refuses."""
    try:
        yield
    except OSError as error:
        file = folder if error.filename is None or PARTIAL in os.fsdecode(error.filename) else error.filename
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            fix = "Free some space and run again; finished work is kept."
            raise StudioError("take.disk_full", "the disk is full", file=folder, fix=fix) from error
        if error.errno == errno.EFBIG:
            problem = "a file would be larger than the file system, or a limit of this session, allows"
            fix = (
                "Look at `ulimit -f`, or choose a folder on another file system, and run again; finished work is kept."
            )
            raise StudioError("take.file_too_large", problem, file=file, fix=fix) from error
        if error.errno in _DISK_FAILED or (error.errno in _DISK_GONE and error.filename is not None):
            problem = f"the disk cannot be read or written ({error.strerror})"
            fix = "Check the disk or the network drive and run again; finished work is kept."
            raise StudioError("take.disk_failed", problem, file=file, fix=fix) from error
        if error.errno in (errno.ENOTDIR, errno.EEXIST):
            problem = "cannot be written: a part of the path is a file, not a folder"
            raise StudioError("take.not_writable", problem, file=file, fix="Choose another folder.") from error
        if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            problem = f"cannot be written ({error.strerror})"
            raise StudioError("take.not_writable", problem, file=file, fix="Choose another folder.") from error
        raise
