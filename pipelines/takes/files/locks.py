"""Locks of files that processes share; the kernel releases them when a process ends for any reason."""

import contextlib
import fcntl
import json
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.studio.bounded_files import parse_json
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject


@contextmanager
def changing(path: Path) -> Iterator[None]:
    """Changes of a file in a take by all processes, one after the other; a killed process holds no lock."""
    if not path.parent.is_dir():  # a take that was removed stays so
        raise StudioError("take.not_found", "no such folder", file=path.parent, fix="Was the take moved or deleted?")
    private = path.parent / ".v3studio"
    with disk_errors(path.parent):
        private.mkdir(exist_ok=True)
        with (private / f"{path.stem}.lock").open("a") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield


@contextmanager
def held(path: Path, refused: Callable[[JsonObject], StudioError], **about: str) -> Iterator[None]:
    """Lock a file for this process, whose `pid` and `host` are written to it with `about`; the kernel releases it when
    the process ends for any reason. `refused`: what to raise if another one holds it, of what `holder_of` says."""
    with path.open("a") as file:
        for _ in range(5):  # who only asks whether it is locked holds it briefly
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            time.sleep(0.05)
        else:
            raise refused(holder_of(path) or {})
        file.truncate(0)
        file.write(json.dumps({"pid": os.getpid(), "host": socket.gethostname(), **about}))
        file.flush()
        try:
            yield
        finally:  # before the lock is released: the next process must never seem to be this one
            file.truncate(0)


def holder_of(path: Path) -> JsonObject | None:
    """`pid`, `host` and what else the process that holds a lock says; {}: it has not said it yet; None: none does."""
    with contextlib.suppress(FileNotFoundError), path.open("r") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            with contextlib.suppress(ValueError):
                return dict(parse_json(file.read()))
            return {}
    return None
