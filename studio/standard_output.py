"""Reserves standard output for what the program itself prints.

Native libraries (PyMeshLab, COLMAP, FFmpeg, OpenCV) write warnings and logs directly to file descriptor 1, bypassing
`sys.stdout`. A program whose output is parsed therefore moves the real standard output to a private descriptor and
redirects descriptor 1 to standard error, for itself and for the processes that it starts.
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
    """Redirect `sys.stdout` to a private copy of standard output, and file descriptor 1 to standard error.

    Call it once, at the start of a process, before native libraries are loaded. Child processes do not inherit the
    private descriptor. Text buffered by C libraries is written to descriptor 1 when the process exits, so it also goes
    to standard error. Characters that the output's encoding cannot represent are escaped. Does nothing if `sys.stdout`
    does not write to descriptor 1.
    """
    if sys.stdout is None:  # closed by the caller; otherwise the next file opened would become descriptor 1
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
    """Make a stream write UTF-8, as JSON requires, regardless of the locale; no-op if its encoding is fixed."""
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(encoding="utf-8", errors="backslashreplace")


def discard(stream: TextIO) -> None:
    """Redirect a stream whose reader is gone to /dev/null, so that Python can flush it at exit without an error."""
    with contextlib.suppress(OSError, ValueError):
        descriptor = stream.fileno()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, descriptor, inheritable=False)
        os.close(nowhere)


class NativeLines:
    """Collects the output of native code on descriptor 1, so that it can be shown without breaking a progress bar.

    Output is collected in a file rather than a pipe: a library that holds the GIL while it fills a pipe would wait
    forever for the thread that empties it. `close` restores descriptor 1.
    """

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115  (closed by `close`)
        self._before: int | None = os.dup(1)
        self._offset = 0
        self._lock = threading.Lock()
        os.dup2(self._file.fileno(), 1)

    def take(self, *, rest: bool = False) -> list[str]:
        """Complete lines since the last call; with `rest`, also an incomplete last line. Thread safe."""
        with self._lock:
            if self._file.closed:
                return []
            descriptor = self._file.fileno()
            # pread, because writers use the file's own offset
            data = os.pread(descriptor, os.fstat(descriptor).st_size - self._offset, self._offset)
            if not rest:
                data = data[: data.rfind(b"\n") + 1]
            self._offset += len(data)
        return data.decode("utf-8", "replace").splitlines()

    def close(self) -> list[str]:
        """Restore descriptor 1; returns the remaining lines."""
        with self._lock:
            if self._before is None:
                return []
            ctypes.CDLL(None).fflush(None)  # flush the buffers of C libraries
            os.dup2(self._before, 1)
            os.close(self._before)
            self._before = None
        lines = self.take(rest=True)
        self._file.close()
        return lines
