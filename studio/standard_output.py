"""Keeps standard output for what the program itself prints.

Native libraries write to file descriptor 1 directly, past `sys.stdout`: PyMeshLab's warnings, COLMAP's log, FFmpeg and
OpenCV. A program whose output is parsed therefore moves the real standard output to a private descriptor and points
descriptor 1 at standard error, for itself and for the processes that it starts.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import io
import os
import sys
import tempfile
import threading
from typing import TextIO


def claim_stdout() -> None:
    """Point `sys.stdout` at a private copy of standard output, and file descriptor 1 at standard error.

    Call it once, at the start of a process, before native libraries are loaded. Child processes do not inherit the
    private descriptor. Text that a C library has buffered is written to descriptor 1 when the process exits, so it ends
    up in standard error as well. Characters that the output's encoding cannot represent are escaped. Does nothing where
    `sys.stdout` does not write to descriptor 1.
    """
    if sys.stdout is None:  # closed by the caller; the next file to be opened would become descriptor 1
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115
        return
    try:
        if sys.stdout.fileno() != 1:
            return
        before = sys.stdout
        before.flush()
        private = fcntl.fcntl(1, fcntl.F_DUPFD_CLOEXEC, 3)
    except (OSError, ValueError):  # replaced by an object without a descriptor
        return
    try:
        os.dup2(2, 1)
    except OSError:  # standard error is closed
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        if nowhere != 2:
            os.close(nowhere)
    sys.stdout = open(  # noqa: SIM115  (open as long as the process lives)
        private,
        "w",
        encoding=before.encoding,
        errors="backslashreplace" if before.errors == "strict" else before.errors,
        buffering=1 if before.isatty() else -1,
    )


def as_utf8(stream: TextIO) -> None:
    """Let a stream write UTF-8, which JSON must be, whatever the locale; no-op where its encoding is fixed."""
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(encoding="utf-8", errors="backslashreplace")


def discard(stream: TextIO) -> None:
    """The reader of this stream is gone: send what is still written to /dev/null, so that Python does not complain
    when it flushes the stream at exit."""
    with contextlib.suppress(OSError, ValueError):
        descriptor = stream.fileno()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, descriptor, inheritable=False)
        os.close(nowhere)


class NativeLines:
    """Collects what native code writes to descriptor 1, so that it can be shown without tearing a progress bar.

    It goes through a file and not a pipe: a library that holds Python's lock while it fills a pipe would wait forever
    for the thread that empties it. Close it to give descriptor 1 back.
    """

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115  (closed by `close`)
        self._before: int | None = os.dup(1)
        self._offset = 0
        self._lock = threading.Lock()
        os.dup2(self._file.fileno(), 1)

    def take(self, *, rest: bool = False) -> list[str]:
        """New whole lines; with `rest`, the unfinished last one too. From any thread."""
        with self._lock:
            if self._file.closed:
                return []
            descriptor = self._file.fileno()
            # pread: the file's own offset belongs to those who write
            data = os.pread(descriptor, os.fstat(descriptor).st_size - self._offset, self._offset)
            if not rest:
                data = data[: data.rfind(b"\n") + 1]
            self._offset += len(data)
        return data.decode("utf-8", "replace").splitlines()

    def close(self) -> list[str]:
        """Give descriptor 1 back; returns the lines that were not taken yet."""
        with self._lock:
            if self._before is None:
                return []
            ctypes.CDLL(None).fflush(None)  # what C libraries have buffered
            os.dup2(self._before, 1)
            os.close(self._before)
            self._before = None
        lines = self.take(rest=True)
        self._file.close()
        return lines
