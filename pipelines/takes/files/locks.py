"""Locks of files that processes share; the kernel releases them when a process ends for any reason."""

import contextlib
import json
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.studio.atomic_files import lock
from v3studio.studio.bounded_files import TextError, parse_json
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.json_types import JsonObject

_WITHOUT_LOCKS = threading.RLock()
"""The lock of threads of this process on a file system that has no locks."""
_LARGEST_PID = 2**31 - 1


@contextmanager
def exclusively(path: Path) -> Iterator[None]:
    """Lock a file for this thread, once no other has it."""
    with path.open("a") as file, contextlib.nullcontext() if lock(file) else _WITHOUT_LOCKS:
        yield


@contextmanager
def changing(path: Path) -> Iterator[None]:
    """Changes of a file in a take by all processes, one after the other."""
    if not path.parent.is_dir():  # a take that was removed stays so
        raise StudioError("take.not_found", "no such folder", file=path.parent, fix="Was the take moved or deleted?")
    private = path.parent / ".v3studio"
    with disk_errors(path.parent):
        private.mkdir(exist_ok=True)
        with exclusively(private / f"{path.stem}.lock"):
            yield


@contextmanager
def held(
    path: Path,
    refused: Callable[[JsonObject], StudioError],
    tell: Callable[[Message], None] | None = None,
    **about: str,
) -> Iterator[None]:
    """Lock a file for this process, whose `pid`, `host` and start are written to it with `about`. `refused` makes what
    is raised if another process holds it, of what `holder_of` says. `tell`: as in `lock`."""
    with path.open("a") as file:
        for _ in range(5):  # who only asks whether it is locked holds it briefly
            with contextlib.suppress(BlockingIOError):
                free = lock(file, wait=False, tell=tell) or holder_of(path) is None
                break
            time.sleep(0.05)
        else:
            free = False
        if not free:
            raise refused(holder_of(path) or {})
        file.truncate(0)
        me = os.getpid()
        file.write(json.dumps({"pid": me, "host": socket.gethostname(), "began": _began(me), **about}))
        file.flush()
        try:
            yield
        finally:  # before the lock is released: the next process must never seem to be this one
            file.truncate(0)


def holder_of(path: Path, anywhere: bool = False) -> JsonObject | None:
    """`pid`, `host` and what else the process that holds a lock says; {}: it has not said it yet; None: none does. On a
    file system without locks, only a process of this machine counts; `anywhere`: also one of another, though it may
    have been killed."""
    with contextlib.suppress(FileNotFoundError), path.open("r") as file:
        try:
            if lock(file, shared=True, wait=False):
                return None
            holder = _said(file.read())
            return holder if _runs(holder, anywhere) else None
        except BlockingIOError:
            return _said(file.read())
    return None


def _said(text: str) -> JsonObject:
    with contextlib.suppress(TextError):
        said = parse_json(text)
        if isinstance(said, dict):
            return said
    return {}


def _runs(holder: JsonObject, anywhere: bool) -> bool:
    pid, here = holder.get("pid"), holder.get("host") == socket.gethostname()
    return isinstance(pid, int) and (_began(pid) in (holder.get("began", ""), "?") if here else anywhere)


def _began(pid: int) -> str | None:
    """The time when a process of this machine began, in the kernel's ticks: one that gets its number later differs.
    None: there is none; "?": the system does not say."""
    import psutil

    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()[19]
    return "?" if pid <= _LARGEST_PID and psutil.pid_exists(pid) else None
