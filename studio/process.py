"""Programs that are started, and what libraries do to this process: its environment, standard output and scheduling.

Every program is started here. `python -m` puts the working folder first on the import path, and so does an empty entry
in PYTHONPATH: a file `argparse.py` beside someone else's footage would be executed.

Entry points call these functions; importing `studio` changes nothing. The environment has to be set before torch is
imported.

Native libraries (PyMeshLab, COLMAP, FFmpeg, OpenCV) write warnings and logs directly to file descriptor 1, bypassing
`sys.stdout`. A program whose output is parsed therefore moves the real standard output to a private descriptor and
redirects descriptor 1 to standard error, for itself and for the processes that it starts.

SVT-AV1, when run by root, gives its own threads and the one that opens it the policy SCHED_FIFO with the highest
priority (`check_set_prio` in its svt_threads.c). Then the thread, its later threads and all programs that it starts
take the processors from everything else on the machine.
"""

import contextlib
import ctypes
import fcntl
import io
import logging
import os
import platform
import shlex
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NoReturn, TextIO

_LOG = logging.getLogger(__name__)

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # parameters of mallopt(3), from malloc.h
_MOST_POOLED, _MOST_KEPT = 2**25, 2**28
"""Bytes: blocks above the first are still returned at once; the second is what a pool keeps."""


def python_command(module: str, *arguments: str) -> list[str]:
    """The command that runs a module with this Python."""
    return [sys.executable, "-P", "-m", module, *arguments]


def start(
    command: Sequence[str], variables: Mapping[str, str] | None = None, **options: Any
) -> subprocess.Popen[bytes]:
    """Start a program, with further environment variables and the options of `subprocess.Popen`. No Python program
    imports anything from its working folder, nor does one that a library of this program starts."""
    process = subprocess.Popen(command, env={**_environment(), **(variables or {})}, **options)
    _LOG.debug("process %d started: %s", process.pid, shlex.join(command))
    return process


@contextlib.contextmanager
def logged(log: logging.Logger, what: str) -> Iterator[None]:
    """Log that a block begins and that it ends, after how many seconds: of a call that never returns, only the first
    line appears. `v3studio COMMAND --verbose` shows these lines."""
    began = time.monotonic()
    log.debug("%s: begins", what)
    try:
        yield
    except BaseException as error:
        log.debug("%s: %s after %.1f s", what, type(error).__name__, time.monotonic() - began)
        raise
    log.debug("%s: ended after %.1f s", what, time.monotonic() - began)


def become(command: Sequence[str]) -> NoReturn:
    """Replace this process by a program, which `start` describes."""
    os.execve(command[0], list(command), _environment())


def forget_working_folder() -> None:
    """Let this process, and those that it or its libraries start, import nothing from the working folder, unless
    PYTHONPATH has its absolute path. Call this at the start of a program: other relative entries of PYTHONPATH become
    absolute, so that they stay the folders that the user meant."""
    os.environ["PYTHONSAFEPATH"] = "1"
    if text := os.environ.get("PYTHONPATH", ""):  # if it is empty, it adds nothing
        entries = text.split(os.pathsep)
        named = [os.path.abspath(entry) for entry in entries if entry and os.path.normpath(entry) != os.curdir]
        os.environ["PYTHONPATH"] = os.pathsep.join(named)
        if len(named) < len(entries) and (here := os.getcwd()) not in named:
            sys.path[:] = [entry for entry in sys.path if entry not in ("", here)]


def _environment() -> dict[str, str]:
    entries = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    absolute = os.pathsep.join(entry for entry in entries if os.path.isabs(entry))
    return {**os.environ, "PYTHONPATH": absolute, "PYTHONSAFEPATH": "1"}


def passive_openmp() -> None:
    """Set OMP_WAIT_POLICY=passive unless it is already set. Call this before torch is imported.

    By default, OpenMP threads spin while they wait. If another process uses the same cores, each small torch operation
    then waits for a whole time slice: a training step on two busy cores took 787 ms with spinning and 42 ms without.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")


def keep_freed_memory() -> None:
    """Let the C library keep freed memory for the next arrays, instead of returning it to the system.

    By default, glibc returns large blocks at once, and each new array costs a page fault per 4 KiB: half of the time of
    a mask, and a part of each training step. Up to 256 MiB per pool of the C library are kept. Without glibc, and if
    the environment sets one of its MALLOC variables, this does nothing.
    """
    if platform.libc_ver()[0] != "glibc" or any(name.startswith("MALLOC_") for name in os.environ):
        return
    mallopt = ctypes.CDLL(None).mallopt
    mallopt(_M_MMAP_THRESHOLD, _MOST_POOLED)
    mallopt(_M_TRIM_THRESHOLD, _MOST_KEPT)


@contextlib.contextmanager
def plot_style(**settings: Any) -> Iterator[None]:
    """Make and draw figures within with Matplotlib's defaults and these settings, in whose names `_` stands for `.`.

    Matplotlib reads a file `matplotlibrc` in the working folder, which may be someone else's take or footage, and
    `text.usetex: True` in it starts LaTeX.
    """
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        named: Any = {name.replace("_", "."): value for name, value in settings.items()}
        matplotlib.rcParams.update(named)
        yield


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
